// Reads the SPL/NAC brain atlas for tests and benchmarks, which skip where it is absent; no general NRRD
// reader.
#pragma once

#include <zlib.h>

#include <fstream>
#include <optional>
#include <sstream>
#include <string>

#include "engine/volume/label_map.h"
#include "engine/volume/separation.h"

namespace sulcus {

inline std::string spl_atlas_folder() {
  return std::string(SULCUS_SOURCE_DIR) + "/../shared/data/spl-brain-atlas/";
}

// The brain alone: labels 4000 .. 4999 (head muscles, eyes) left out. Nothing if the file is absent or
// another one.
inline std::optional<LabelMap> read_spl_brain() {
  std::ifstream file(spl_atlas_folder() + "hncma-atlas-2014.nrrd", std::ios::binary);
  if (!file) return std::nullopt;
  const std::string text((std::istreambuf_iterator<char>(file)), {});
  const std::size_t data = text.find("\n\n");
  if (data == std::string::npos || text.find("sizes: 256 256 256") > data) return std::nullopt;

  LabelMap map;
  map.size = {256, 256, 256};
  map.spacing = Vec3::Constant(1e-3);
  map.direction << 0, 0, 1, 1, 0, 0, 0, -1, 0;
  map.origin = Vec3(-128e-3, -128e-3, 128e-3);
  std::vector<std::int16_t> voxels(std::size_t{256} * 256 * 256);
  z_stream stream{};
  inflateInit2(&stream, 15 + 32);
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(text.data() + data + 2));
  stream.avail_in = static_cast<uInt>(text.size() - data - 2);
  stream.next_out = reinterpret_cast<Bytef*>(voxels.data());
  stream.avail_out = static_cast<uInt>(voxels.size() * sizeof(std::int16_t));
  const int end = inflate(&stream, Z_FINISH);
  inflateEnd(&stream);
  if (end != Z_STREAM_END || stream.avail_out != 0) return std::nullopt;
  for (const std::int16_t label : voxels) map.labels.push_back(label >= 4000 && label < 5000 ? 0 : label);
  return map;
}

// The thesis' pairs of one group, e.g. "Sylvian fissure", or of all groups if the name is empty.
inline SeparationPairs read_thesis_pairs(const std::string& group) {
  std::ifstream file(spl_atlas_folder() + "thesis-separation-pairs.txt");
  std::vector<std::pair<std::int32_t, std::int32_t>> pairs;
  bool wanted = group.empty();
  for (std::string line; std::getline(file, line);) {
    if (line.empty() || line[0] == '#') continue;
    if (line[0] == '[') {
      wanted = group.empty() || line == "[" + group + "]";
      continue;
    }
    std::istringstream numbers(line);
    std::int32_t a = 0, b = 0;
    if (wanted && numbers >> a >> b) pairs.emplace_back(a, b);
  }
  return make_separation_pairs(pairs);
}

}  // namespace sulcus
