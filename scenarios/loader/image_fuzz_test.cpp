// Damaged image files: each is read or refused with a message, without a crash, a hang or unbounded memory.
// A short run among the tests; a long one, in a build with sanitizers:
//   SULCUS_FUZZ_SECONDS=60 build/asan/scenarios/image_fuzz_test
// A failure names its number; SULCUS_FUZZ_FIRST=<number> begins there.
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <random>

#include "engine/numerics/error.h"
#include "scenarios/loader/images.h"

// ITK's NIfTI reader and writer leak the names of their files.
extern "C" __attribute__((visibility("default"))) const char* __lsan_default_suppressions();
const char* __lsan_default_suppressions() {
  return "leak:libITKniftiio\nleak:libITKIONRRD\nleak:libITKNrrdIO\nleak:libITKMetaIO\nleak:libITKznz\n";
}
extern "C" __attribute__((visibility("default"))) const char* __lsan_default_options();
const char* __lsan_default_options() {
  return "print_suppressions=0";
}

namespace sulcus {
namespace {
namespace fs = std::filesystem;

constexpr int short_run = 600;                 // files
constexpr unsigned longest_s = 60;             // for one file, on a busy machine: more is a hang
constexpr long most_memory_kB = 1200L * 1000;  // above what the program needs itself

std::string read_file(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

std::uint64_t below(std::mt19937_64& random, std::uint64_t count) {
  return random() % count;
}

// Sound files: name of the one to read, its bytes, and of a data file beside it.
struct Sound {
  std::string name, bytes, data_name, data;
};

std::vector<Sound> sound_files(const fs::path& folder) {
  LabelMap map;
  map.size = {6, 5, 4};
  map.spacing = {0.001, 0.002, 0.0015};
  for (int v = 0; v < 120; ++v) map.labels.push_back(v * v % 300);
  std::vector<Sound> files;
  for (const char* name : {"a.nrrd", "a.nhdr", "a.nii", "a.nii.gz", "a.mha", "a.mhd"}) {
    write_label_map(folder / name, map);
    const std::vector<fs::path> written = label_map_files(folder / name);
    Sound sound{name, read_file(written[0]), "", ""};
    if (written.size() > 1) {
      sound.data_name = written[1].filename().string();
      sound.data = read_file(written[1]);
    }
    for (const fs::path& file : written) fs::remove(file);
    files.push_back(sound);
  }
  const std::string raw(240, '\1');
  files.push_back({"raw.nrrd",
                   "NRRD0004\ntype: int16\ndimension: 3\nspace: left-posterior-superior\nsizes: 6 5 4\n"
                   "space directions: (1,0,0) (0,1,0) (0,0,1)\nendian: big\nencoding: raw\n\n" +
                       raw,
                   "", ""});
  std::string numbers;
  for (int v = 0; v < 120; ++v) numbers += std::to_string(v % 7) + " ";
  files.push_back(
      {"text.nrrd",
       "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 6 5 4\nspacings: 1 1 2\nencoding: ascii\n\n" + numbers,
       "", ""});
  files.push_back({"raw.mha",
                   "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\n"
                   "ElementSpacing = 1 1 1\nDimSize = 6 5 4\nElementType = MET_SHORT\n"
                   "ElementDataFile = LOCAL\n" +
                       raw,
                   "", ""});
  // a NIfTI pair: the same header with the data in a file of its own
  std::string header = files[2].bytes.substr(0, 348);
  header.replace(344, 4, std::string("ni1\0", 4));
  header.replace(108, 4, std::string(4, '\0'));
  files.push_back({"pair.hdr", header, "pair.img", files[2].bytes.substr(352)});
  return files;
}

// A few random changes.
void damage(std::string& bytes, const std::vector<Sound>& others, std::mt19937_64& random) {
  static const char* const words[] = {"0",  "-1",   "1e308", "nan",   "99999999999", "2147483647", "65536",
                                      "\n", "\n\n", "LIST",  "%03d",  "gzip",        "hex",        "3 3 3 3",
                                      ":",  "=",    "none",  "local", "../",         "True"};
  for (std::uint64_t round = 0; round <= below(random, 4); ++round) {
    if (bytes.empty()) return;
    const std::size_t at = below(random, bytes.size());
    // most of what matters stands at the beginning
    const std::size_t near = below(random, 2) ? at : at % 400 % bytes.size();
    switch (below(random, 9)) {
      case 0:
        bytes[near] = static_cast<char>(bytes[near] ^ (1 << below(random, 8)));
        break;
      case 1:
        bytes[near] = static_cast<char>(random());
        break;
      case 2:
        bytes.resize(at);
        break;
      case 3:
        bytes.insert(near, bytes.substr(at, below(random, 40)));
        break;
      case 4:
        bytes.erase(near, 1 + below(random, 20));
        break;
      case 5:
        bytes.insert(near, words[below(random, std::size(words))]);
        break;
      case 6: {  // an extreme number in a binary header
        static const std::uint32_t numbers[] = {0,          1,          0x7fffffff, 0x80000000,
                                                0xffffffff, 0x7f800000, 0x7fc00000, 0x00010000};
        const std::uint32_t number = numbers[below(random, std::size(numbers))];
        if (near + 4 <= bytes.size()) bytes.replace(near, 4, reinterpret_cast<const char*>(&number), 4);
        break;
      }
      case 7: {  // a digit of a text header
        const std::size_t digit = bytes.find_first_of("0123456789", near);
        if (digit != std::string::npos) bytes[digit] = static_cast<char>('0' + below(random, 10));
        break;
      }
      default: {  // a piece of another file
        const std::string& other = others[below(random, others.size())].bytes;
        bytes.replace(near, std::min<std::size_t>(bytes.size() - near, 30),
                      other.substr(below(random, other.size()), 30));
      }
    }
  }
}

void write_file(const fs::path& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}

// Whether the file was read; a refusal has a message with the file's name.
bool read_or_refuse(const fs::path& path, std::uint64_t number) {
  bool was_read = false;
  for (const ImageUse use : {ImageUse::labels, ImageUse::grey}) {
    try {
      const VoxelImage image = read_image(path, use);
      EXPECT_LE(image.bytes.size(), 1U << 30) << number;
      if (use == ImageUse::labels) read_label_map(path);
      was_read = true;
    } catch (const InputError& refusal) {
      EXPECT_NE(std::string(refusal.what()).find(path.parent_path().string()), std::string::npos)
          << number << ": " << refusal.what();
    } catch (const std::exception& error) {
      ADD_FAILURE() << "file " << number << ": not a refusal: " << error.what();
    }
  }
  return was_read;
}

long memory_kB() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return usage.ru_maxrss;
}

TEST(DamagedImages, AreReadOrRefused) {
  const fs::path folder = fs::path(testing::TempDir()) / ("sulcus_fuzz_" + std::to_string(getpid()));
  fs::create_directories(folder);
  const std::vector<Sound> sound = sound_files(folder);
  for (const Sound& file : sound) {  // the sound ones are read
    write_file(folder / file.name, file.bytes);
    if (!file.data_name.empty()) write_file(folder / file.data_name, file.data);
    EXPECT_TRUE(read_or_refuse(folder / file.name, 0)) << file.name;
    fs::remove(folder / file.name);
    if (!file.data_name.empty()) fs::remove(folder / file.data_name);
  }
  const char* const seconds = std::getenv("SULCUS_FUZZ_SECONDS");
  const char* const first = std::getenv("SULCUS_FUZZ_FIRST");
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(seconds ? std::atol(seconds) : 0);
  const long before_kB = memory_kB();
  std::uint64_t number = first ? std::strtoull(first, nullptr, 10) : 1, tried = 0, were_read = 0;
  for (; seconds ? std::chrono::steady_clock::now() < end : tried < short_run; ++number, ++tried) {
    std::mt19937_64 random(number);
    Sound file = sound[below(random, sound.size())];
    const bool in_data = !file.data_name.empty() && below(random, 2) == 0;
    damage(in_data ? file.data : file.bytes, sound, random);
    write_file(folder / file.name, file.bytes);
    if (!file.data_name.empty()) write_file(folder / file.data_name, file.data);
    if (seconds) {  // known if the program dies
      std::ofstream(fs::path(testing::TempDir()) / "sulcus_fuzz_last") << number << " " << file.name << "\n";
    }
    alarm(longest_s);
    were_read += read_or_refuse(folder / file.name, number);
    alarm(0);
    if (testing::Test::HasFailure()) break;
    for (const auto& entry : fs::directory_iterator(folder)) fs::remove_all(entry.path());
  }
  const long grown_kB = memory_kB() - before_kB;
  std::printf("%llu damaged files, %llu of them read, the others refused; memory grew by %ld kB\n",
              static_cast<unsigned long long>(tried), static_cast<unsigned long long>(were_read), grown_kB);
  EXPECT_LT(grown_kB, most_memory_kB);
  EXPECT_GT(were_read, tried / 50);      // some damage does not matter
  EXPECT_LT(were_read, tried * 9 / 10);  // most does
  fs::remove_all(folder);
}

}  // namespace
}  // namespace sulcus
