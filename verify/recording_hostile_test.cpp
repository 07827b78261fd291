// Recordings that are missing, cut, damaged or made to mislead, and places that cannot be written to.
#include <gtest/gtest.h>
#include <hdf5.h>
#include <sys/mount.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <functional>
#include <random>

#include "engine/numerics/error.h"
#include "verify/recording.h"
#include "verify/test_run.h"

// HDF5 itself loses some memory when a write fails; not ours to repair. Read by the leak sanitizer, if there
// is one.
extern "C" __attribute__((visibility("default"))) const char* __lsan_default_suppressions();
const char* __lsan_default_suppressions() {
  return "leak:libhdf5\n";
}
extern "C" __attribute__((visibility("default"))) const char* __lsan_default_options();
const char* __lsan_default_options() {
  return "print_suppressions=0";
}

namespace sulcus {
namespace {

// The message of the InputError that reading gives; fails the test on anything else.
std::string refusal(const std::filesystem::path& path) {
  try {
    read_run(path);
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find(path.string()), std::string::npos) << error.what();
    return error.what();
  }
  ADD_FAILURE() << path << " was read";
  return "";
}

#define EXPECT_SAYS(message, part) \
  EXPECT_NE((message).find(part), std::string::npos) << "message: " << (message)

TEST(HostileRecording, MissingFileDirectoryAndOtherFilesAreRefused) {
  const auto dir = test::scratch_dir();
  EXPECT_SAYS(refusal(dir / "missing.h5"), "No such file");
  EXPECT_SAYS(refusal(dir), "Is a directory");
  test::write_text(dir / "empty", "");
  EXPECT_SAYS(refusal(dir / "empty"), "not a recording");
  test::write_text(dir / "text", "not HDF5 at all");
  EXPECT_SAYS(refusal(dir / "text"), "not a recording");
  test::write_text(dir / "text", std::string(100'000, 'x'));
  EXPECT_SAYS(refusal(dir / "text"), "not a recording");
}

TEST(HostileRecording, OtherFormatVersionIsNamed) {
  const auto path = test::scratch_dir() / "run.h5";
  test::record_small_run(path, 5);
  std::string bytes = test::read_text(path);
  bytes[8] = 9;
  test::write_text(path, bytes);
  EXPECT_SAYS(refusal(path), "format version 9");
}

TEST(HostileRecording, CutAtAnyPlaceIsRefused) {
  const auto path = test::scratch_dir() / "run.h5";
  test::record_small_run(path, 20);
  const std::string bytes = test::read_text(path);
  for (std::size_t length = 0; length < bytes.size(); length += length < 600 ? 37 : 1009) {
    test::write_text(path, bytes.substr(0, length));
    refusal(path);
  }
  test::write_text(path, bytes.substr(0, bytes.size() - 1));
  EXPECT_SAYS(refusal(path), "cut or damaged");
  test::write_text(path, bytes + "x");
  EXPECT_SAYS(refusal(path), "cut or damaged");
  test::write_text(path, bytes);
  EXPECT_EQ(read_run(path).steps, 20);
}

TEST(HostileRecording, AnyChangedByteIsRefused) {
  const auto path = test::scratch_dir() / "run.h5";
  test::record_small_run(path, 20);
  const std::string bytes = test::read_text(path);
  const std::uint64_t seed = std::random_device{}();
  RecordProperty("seed", std::to_string(seed));
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937_64 random(seed);
  for (int trial = 0; trial < 400; ++trial) {
    std::string mutated = bytes;
    const std::size_t place = trial < 100 ? static_cast<std::size_t>(trial) * 6 : random() % bytes.size();
    const auto flip = static_cast<char>(1 + random() % 255);
    mutated[place] = static_cast<char>(mutated[place] ^ flip);
    test::write_text(path, mutated);
    refusal(path);
  }
}

// Bytes changed and sealed again: the seal is no help then, and what is read may be wrong, but nothing
// crashes. The seed is fixed, so that the outcome is.
TEST(HostileRecording, ChangedBytesUnderAFreshSealDoNotCrash) {
  const auto path = test::scratch_dir() / "run.h5";
  test::record_small_run(path, 20);
  const std::string bytes = test::read_text(path);
  std::mt19937_64 random(1);
  int refused = 0;
  for (int trial = 0; trial < 60; ++trial) {
    std::string mutated = bytes;
    for (int change = 0; change < 4; ++change) {
      const std::size_t place = 512 + random() % (bytes.size() - 512);
      mutated[place] = static_cast<char>(random() & 0xff);
    }
    test::write_text(path, mutated);
    seal_recording(path);
    try {
      read_run(path);
    } catch (const InputError&) {
      ++refused;
    }
  }
  EXPECT_GT(refused, 0);
}

// --- files that HDF5 finds in order, whose content is not

class Crafted : public ::testing::Test {
 protected:
  void SetUp() override {
    path_ = test::scratch_dir() / "run.h5";
    test::record_small_run(path_, 20);
  }
  // Edits the file by HDF5, seals it again, and returns what reading says.
  std::string after(const std::function<void(hid_t file)>& edit) {
    const hid_t file = H5Fopen(path_.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
    EXPECT_GE(file, 0);
    edit(file);
    EXPECT_GE(H5Fclose(file), 0);
    seal_recording(path_);
    return refusal(path_);
  }
  static void remove(hid_t file, const char* name) {
    EXPECT_GE(H5Ldelete(file, name, H5P_DEFAULT), 0) << name;
  }
  // A dataset of doubles without data: its extents are a claim only.
  static void claim(hid_t file, const char* name, std::vector<hsize_t> extent, hid_t type = H5T_IEEE_F64LE) {
    const hid_t space = H5Screate_simple(static_cast<int>(extent.size()), extent.data(), nullptr);
    const hid_t creation = H5Pcreate(H5P_DATASET_CREATE);
    const std::vector<hsize_t> chunk(extent.size(), 1);
    H5Pset_chunk(creation, static_cast<int>(extent.size()), chunk.data());
    const hid_t dataset = H5Dcreate2(file, name, type, space, H5P_DEFAULT, creation, H5P_DEFAULT);
    EXPECT_GE(dataset, 0) << name;
    H5Dclose(dataset);
    H5Pclose(creation);
    H5Sclose(space);
  }
  std::filesystem::path path_;
};

TEST_F(Crafted, EveryMissingDatasetIsNamed) {
  const std::string bytes = test::read_text(path_);
  for (const char* name :
       {"/header/scenario_json", "/header/tool_names", "/header/build/keys", "/mesh/tets",
        "/mesh/rest_positions_m", "/device/0/buttons", "/device/0/position_m", "/fingerprint/chain",
        "/fingerprint/fields", "/frames/step", "/frames/alive", "/final_state/rotations", "/final_state/step",
        "/solver_error/error", "/numbers/values", "/warnings", "/events/text", "/series", "/device"}) {
    test::write_text(path_, bytes);
    const std::string message = after([&](hid_t file) { remove(file, name); });
    EXPECT_SAYS(message, name);
    EXPECT_SAYS(message, "is missing");
  }
}

TEST_F(Crafted, HugeClaimsAreRefusedBeforeTheyAreAllocated) {
  const std::string bytes = test::read_text(path_);
  const hsize_t huge = hsize_t{1} << 50;
  EXPECT_SAYS(after([&](hid_t file) {
                remove(file, "/mesh/rest_positions_m");
                claim(file, "/mesh/rest_positions_m", {huge});
              }),
              "larger than the file can hold");
  test::write_text(path_, bytes);
  EXPECT_SAYS(after([&](hid_t file) {
                remove(file, "/mesh/rest_positions_m");
                claim(file, "/mesh/rest_positions_m", {3'000'000});
              }),
              "says it holds");
  test::write_text(path_, bytes);
  EXPECT_SAYS(after([&](hid_t file) {
                remove(file, "/frames/step");
                claim(file, "/frames/step", {huge, huge}, H5T_STD_I64LE);
              }),
              "shape");
  test::write_text(path_, bytes);
  EXPECT_SAYS(after([&](hid_t file) {
                const std::int64_t steps = 999'999'999;
                const hid_t attribute = H5Aopen(file, "steps", H5P_DEFAULT);
                H5Awrite(attribute, H5T_NATIVE_INT64, &steps);
                H5Aclose(attribute);
              }),
              "has shape");
}

TEST_F(Crafted, ContradictingShapesAreRefused) {
  const std::string bytes = test::read_text(path_);
  const auto resized = [&](const char* name, std::vector<hsize_t> extent) {
    test::write_text(path_, bytes);
    return after([&](hid_t file) {
      const hid_t dataset = H5Dopen2(file, name, H5P_DEFAULT);
      EXPECT_GE(H5Dset_extent(dataset, extent.data()), 0) << name;
      H5Dclose(dataset);
    });
  };
  EXPECT_SAYS(resized("/series/tools/0/contact_force_N", {19, 3}), "has shape [19, 3], expected [20, 3]");
  EXPECT_SAYS(resized("/series/time_s", {21}), "has shape [21], expected [20]");
  EXPECT_SAYS(resized("/device/0/position_m", {20, 2}), "expected [20, 3]");
  EXPECT_SAYS(resized("/fingerprint/chain", {20}), "expected [21]");
  EXPECT_SAYS(resized("/frames/positions_m", {1, 12}), "expected [1, 15]");
}

TEST_F(Crafted, WrongTypesLinksAndNumbersAreRefused) {
  const std::string bytes = test::read_text(path_);
  EXPECT_SAYS(after([&](hid_t file) {
                remove(file, "/series/time_s");
                claim(file, "/series/time_s", {20}, H5T_STD_I64LE);
              }),
              "wrong element type");
  test::write_text(path_, bytes);
  EXPECT_SAYS(after([&](hid_t file) {
                remove(file, "/series/time_s");
                H5Lcreate_external("/etc/passwd", "/x", file, "/series/time_s", H5P_DEFAULT, H5P_DEFAULT);
              }),
              "soft or external link");
  test::write_text(path_, bytes);
  EXPECT_SAYS(after([&](hid_t file) {
                remove(file, "/warnings");
                H5Lcreate_soft("/events/text", file, "/warnings", H5P_DEFAULT, H5P_DEFAULT);
              }),
              "soft or external link");
  test::write_text(path_, bytes);
  EXPECT_SAYS(after([&](hid_t file) {
                H5Lcreate_hard(file, "/series", file, "/series/again", H5P_DEFAULT, H5P_DEFAULT);
              }),
              "nested too deeply");
  test::write_text(path_, bytes);
  EXPECT_SAYS(after([&](hid_t file) {
                const std::int32_t tets[8] = {0, 1, 2, 3, 1, 2, 3, 5};
                const hid_t dataset = H5Dopen2(file, "/mesh/tets", H5P_DEFAULT);
                H5Dwrite(dataset, H5T_NATIVE_INT32, H5S_ALL, H5S_ALL, H5P_DEFAULT, tets);
                H5Dclose(dataset);
              }),
              "names node 5");
  test::write_text(path_, bytes);
  EXPECT_SAYS(after([&](hid_t file) {
                std::vector<std::uint64_t> chain(21, 7);
                const hid_t dataset = H5Dopen2(file, "/fingerprint/chain", H5P_DEFAULT);
                H5Dwrite(dataset, H5T_NATIVE_UINT64, H5S_ALL, H5S_ALL, H5P_DEFAULT, chain.data());
                H5Dclose(dataset);
              }),
              "does not follow");
}

// --- places that cannot be written to

TEST(RecordingPlace, ThatCannotBeWrittenToIsAnEnvironmentError) {
  const RunHeader header = test::small_header();
  const State state = test::small_state(header);
  const auto file = test::scratch_dir() / "file";
  test::write_text(file, "x");
  for (const std::filesystem::path& path : {file / "run.h5", std::filesystem::path("/proc/run.h5"),
                                            test::scratch_dir() / "no such directory" / "run.h5"}) {
    try {
      RunWriter writer(path, header, state);
      ADD_FAILURE() << path;
    } catch (const EnvironmentError& error) {
      EXPECT_SAYS(std::string(error.what()), path.string());
      EXPECT_SAYS(std::string(error.what()), "choose a place");
    }
  }
}

// Records until the place is full. Exit code: 0 if that came as an EnvironmentError that says `reason`,
// nothing stands under the final name, the partial file is kept, and the program goes on in order.
int record_until_full(const std::filesystem::path& path, const std::string& reason, std::int64_t nodes) {
  RunHeader header = test::small_header();
  std::mt19937_64 random(7);
  for (std::int64_t i = 0; i < 3 * nodes; ++i)
    header.rest_positions.push_back(static_cast<double>(random()) * 1e-20);
  State state = test::small_state(header);
  std::string message;
  try {
    RunWriter writer(path, header, state);
    try {
      for (std::int64_t n = 0; n < 5000; ++n) {
        const test::SmallStep step = test::advance(header, n, state);
        writer.write_step(step.samples, step.report, state, step.stage_s, 0);
        if (n % 10 == 0) {
          for (double& x : state.positions) x = static_cast<double>(random()) * 1e-20;
          writer.write_frame(state, step.report.time_s);
        }
      }
      writer.finish(state);
    } catch (const EnvironmentError& error) {
      message = error.what();
      try {
        writer.finish(state);
        return 2;
      } catch (const EnvironmentError&) {
      }
    }
  } catch (const EnvironmentError& error) {
    message = error.what();
  }
  std::fprintf(stderr, "%s\n", message.c_str());
  if (message.find(reason) == std::string::npos) return 3;
  if (message.find("free space") == std::string::npos) return 4;
  if (std::filesystem::exists(path)) return 5;
  if (!std::filesystem::exists(path.string() + ".part")) return 6;
  return 0;
}

// In a process of its own, which has to end by itself with that code and say nothing but the message.
int exit_code_of_child(const std::function<int()>& work, std::string& said) {
  int pipe_ends[2];
  if (::pipe(pipe_ends) != 0) return -1;
  const pid_t child = ::fork();
  if (child == 0) {
    ::dup2(pipe_ends[1], 2);
    ::close(pipe_ends[0]);
    std::exit(work());
  }
  ::close(pipe_ends[1]);
  char buffer[4096];
  for (ssize_t got; (got = ::read(pipe_ends[0], buffer, sizeof buffer)) > 0;)
    said.append(buffer, static_cast<std::size_t>(got));
  ::close(pipe_ends[0]);
  int status = 0;
  ::waitpid(child, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

TEST(RecordingPlace, FileThatMayNotGrowIsAnEnvironmentErrorAndTheProgramGoesOn) {
  const auto dir = test::scratch_dir();
  for (const std::int64_t kilobytes : {4, 30, 60, 200, 500}) {
    std::string said;
    const int code = exit_code_of_child(
        [&] {
          std::signal(SIGXFSZ, SIG_IGN);
          const auto bytes = static_cast<rlim_t>(kilobytes) * 1024;
          const rlimit limit{bytes, bytes};
          ::setrlimit(RLIMIT_FSIZE, &limit);
          return record_until_full(dir / "run.h5", "recording failed", 2000);
        },
        said);
    EXPECT_EQ(code, 0) << kilobytes << " kB: " << said;
    EXPECT_EQ(std::count(said.begin(), said.end(), '\n'), 1) << said;
    EXPECT_SAYS(said, "File too large");
  }
}

TEST(RecordingPlace, FullDiskIsAnEnvironmentErrorAndTheProgramGoesOn) {
  const auto dir = test::scratch_dir();
  if (::mount("tmpfs", dir.c_str(), "tmpfs", 0, "size=256k") != 0)
    GTEST_SKIP() << "mounting a small disk is not permitted here";
  std::string said;
  const int code =
      exit_code_of_child([&] { return record_until_full(dir / "run.h5", "the disk is full", 2000); }, said);
  EXPECT_EQ(code, 0) << said;
  EXPECT_EQ(std::count(said.begin(), said.end(), '\n'), 1) << said;
  EXPECT_EQ(::umount2(dir.c_str(), MNT_DETACH), 0);
}

}  // namespace
}  // namespace sulcus
