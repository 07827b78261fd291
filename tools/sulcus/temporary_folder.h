// A folder that goes when its owner ends.
#pragma once

#include <cstdlib>
#include <filesystem>
#include <string>

#include "engine/numerics/error.h"

namespace sulcus {

struct TemporaryFolder {
  std::filesystem::path path;

  TemporaryFolder() {
    std::string name = std::filesystem::temp_directory_path() / "sulcus_XXXXXX";
    if (mkdtemp(name.data()) == nullptr)
      throw EnvironmentError(name + ": cannot be made; let TMPDIR name a folder that can be written to");
    path = name;
  }
  ~TemporaryFolder() {
    std::error_code error;
    std::filesystem::remove_all(path, error);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
};

}  // namespace sulcus
