#include <gtest/gtest.h>

#include <cstdlib>

#include "hw_phantom/hdapi.h"
#include "hw_phantom/standin_access.h"

namespace sulcus {
namespace {

// The failure and the message of load(), or of open().
template <class Call>
hd::OpenError failure_of(Call&& call) {
  try {
    call();
  } catch (const hd::OpenError& error) {
    return error;
  }
  throw std::logic_error("no failure");
}

bool tells(const hd::OpenError& error, const std::string& word) {
  return std::string(error.what()).find(word) != std::string::npos;
}

TEST(Loading, AbsentLibraryNamesWhatWasTriedAndWhatToInstall) {
  const auto error = failure_of([] { hd::load("/nowhere/libHD.so"); });
  EXPECT_EQ(error.failure, hd::Failure::library_absent);
  EXPECT_TRUE(tells(error, "/nowhere/libHD.so")) << error.what();
  EXPECT_TRUE(tells(error, "SULCUS_LIBHD")) << error.what();
}

TEST(Loading, AbsentDependencyShowsTheLoadersWordsAndAHint) {
  const auto error = failure_of([] { hd::load(PHANTOM_STANDINS "/needs_io/libHD.so"); });
  EXPECT_EQ(error.failure, hd::Failure::dependency_absent);
  EXPECT_TRUE(tells(error, "libPhantomIOLib42.so: cannot open shared object file")) << error.what();
  EXPECT_TRUE(tells(error, "install the Touch device driver")) << error.what();
}

TEST(Loading, AbsentSymbolIsNamed) {
  const auto error = failure_of([] { hd::load(PHANTOM_STANDINS "/no_symbol/libHD.so"); });
  EXPECT_EQ(error.failure, hd::Failure::symbol_absent);
  EXPECT_TRUE(tells(error, "hdDisableDevice")) << error.what();
}

TEST(Loading, FileThatIsNoLibraryIsNotCalledAbsent) {
  const auto error = failure_of([] { hd::load(SULCUS_SOURCE_DIR "/CMakeLists.txt"); });
  EXPECT_EQ(error.failure, hd::Failure::dependency_absent);
  EXPECT_TRUE(tells(error, "invalid ELF header") || tells(error, "file too short")) << error.what();
}

TEST(Loading, SearchesSettingThenEnvironmentThenSystem) {
  unsetenv("SULCUS_LIBHD");
  const auto paths = hd::search_order("");
  ASSERT_GT(paths.size(), 4u);
  EXPECT_EQ(paths[0], "libHD.so.3.4");
  EXPECT_EQ(paths[1], "libHD.so");
  EXPECT_EQ(paths[4], "/usr/lib/libHD.so.3.4");
  setenv("SULCUS_LIBHD", standin_path(), 1);
  EXPECT_EQ(hd::search_order(""), std::vector<std::string>{standin_path()});
  EXPECT_EQ(hd::search_order("/a"), std::vector<std::string>{"/a"});
  EXPECT_EQ(hd::load("").path, standin_path());
  unsetenv("SULCUS_LIBHD");
}

TEST(Loading, ErrorsAreDescribedInWords) {
  EXPECT_EQ(hd::describe(0x0302, -28), "0x0302 (communication lost), internal -28");
  EXPECT_EQ(hd::describe(0x0777, 0), "0x0777 (unknown error), internal 0");
  for (unsigned int code = 0; code < 0x700; ++code) {
    EXPECT_EQ(hd::is_recoverable(code), code >= 0x0200 && code <= 0x0204) << code;
  }
}

}  // namespace
}  // namespace sulcus
