// The laws of the house that can be read off files: who includes whom, what the engine links, which
// instructions and which functions its object code holds.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <string>
#include <vector>

#include "engine/numerics/test_shell.h"

namespace {
namespace fs = std::filesystem;

const fs::path source = SULCUS_SOURCE_DIR;
const fs::path binary = SULCUS_BINARY_DIR;

struct Include {
  fs::path file;
  std::string name;
  bool quoted;
};

std::vector<Include> includes_below(const fs::path& folder) {
  std::vector<Include> found;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    const std::string extension = entry.path().extension();
    if (extension != ".h" && extension != ".cpp") continue;
    std::ifstream file(entry.path());
    for (std::string line; std::getline(file, line);) {
      if (!line.starts_with("#include ")) continue;
      const bool quoted = line[9] == '"';
      const auto end = line.find(quoted ? '"' : '>', 10);
      found.push_back({fs::relative(entry.path(), source), line.substr(10, end - 10), quoted});
    }
  }
  return found;
}

std::string first_folder(const fs::path& path) {
  return path.begin()->string();
}

bool for_tests(const fs::path& file) {
  const std::string name = file.filename();
  return name.starts_with("test_") || name.find("_test.") != std::string::npos ||
         name.find("_bench.") != std::string::npos;
}

std::string run(const std::string& command) {
  return sulcus::test::shell(command).output;
}

// A room of the engine includes only rooms to its left; the bars make groups of equals.
const std::map<std::string, int> engine_order = {
    {"numerics", 0}, {"volume", 0},  {"device", 0}, {"mesh", 1},     {"tool", 1},
    {"fem", 2},      {"contact", 2}, {"solver", 3}, {"fracture", 3}, {"scene", 4}};
// Of two rooms of one group these may still see each other, in this direction.
const std::vector<std::pair<std::string, std::string>> engine_extra = {{"volume", "numerics"},
                                                                       {"device", "numerics"}};

TEST(House, ArrowsBetweenRoomsRunOneWay) {
  const std::map<std::string, std::vector<std::string>> allowed = {
      {"engine", {"engine"}},
      {"device_sim", {"device_sim", "engine"}},
      {"hw_phantom", {"hw_phantom", "engine"}},
      {"scenarios", {"scenarios", "device_sim", "engine"}},
      {"verify", {"verify", "engine"}},
      {"tools", {"tools", "verify", "scenarios", "device_sim", "hw_phantom", "engine"}}};
  int checked = 0;
  for (const auto& [room, targets] : allowed) {
    for (const Include& include : includes_below(source / room)) {
      if (!include.quoted) continue;
      const std::string target = first_folder(include.name);
      EXPECT_TRUE(std::find(targets.begin(), targets.end(), target) != targets.end())
          << include.file << " includes " << include.name;
      ++checked;
    }
  }
  EXPECT_GT(checked, 300);
}

TEST(House, RoomsOfTheEngineIncludeOnlyWhatLiesBelowThem) {
  for (const Include& include : includes_below(source / "engine")) {
    if (!include.quoted) continue;
    const std::string from = (++include.file.begin())->string();
    const fs::path name = include.name;
    const std::string to = (++name.begin())->string();
    if (from == to) continue;
    ASSERT_TRUE(engine_order.contains(from) && engine_order.contains(to))
        << include.file << ' ' << include.name;
    const bool extra =
        std::find(engine_extra.begin(), engine_extra.end(), std::pair(from, to)) != engine_extra.end();
    const bool test_bodies = for_tests(include.file) && include.name.starts_with("engine/fem/test_");
    EXPECT_TRUE(engine_order.at(to) < engine_order.at(from) || extra || test_bodies)
        << include.file << " includes " << include.name;
  }
}

TEST(House, TheEngineKnowsNoFileFormatsAndNoPixels) {
  for (const Include& include : includes_below(source / "engine")) {
    for (const char* foreign :
         {"nlohmann", "hdf5", "H5", "itk", "CLI", "GL/", "png", "valijson", "xxhash", "ft2build"}) {
      EXPECT_FALSE(include.name.starts_with(foreign)) << include.file << " includes " << include.name;
    }
    EXPECT_FALSE(!for_tests(include.file) &&
                 (include.name == "random" || include.name == "chrono" || include.name == "unordered_map" ||
                  include.name == "unordered_set"))
        << include.file << " includes <" << include.name << ">";
  }
}

std::vector<fs::path> engine_libraries() {
  std::vector<fs::path> libraries;
  for (const auto& entry : fs::recursive_directory_iterator(binary / "engine")) {
    if (entry.path().extension() == ".a") libraries.push_back(entry.path());
  }
  return libraries;
}

TEST(House, NoFusedMultiplyAddAndNoApproximateReciprocalInTheEnginesObjectCode) {
  const auto libraries = engine_libraries();
  ASSERT_GE(libraries.size(), 8u);
  long multiplications = 0;
  for (const fs::path& library : libraries) {
    const std::string counts = run("objdump -d --no-show-raw-insn '" + library.string() +
                                   "' | awk '/\\tvf[n]?m(add|sub)|\\tv?r(sqrt|cp)(14|28)?[ps][sd]/ { bad++ } "
                                   "/mul[ps][sd]/ { good++ } END { print bad + 0, good + 0 }'");
    long bad = -1, good = 0;
    ASSERT_EQ(std::sscanf(counts.c_str(), "%ld %ld", &bad, &good), 2) << library << ' ' << counts;
    EXPECT_EQ(bad, 0) << library;
    multiplications += good;
  }
  EXPECT_GT(multiplications, 1000) << "the disassembly shows no arithmetic: the check looks at nothing";
}

// Eigen must not choose its own vectors, and nobody contracts: every file of the engine is compiled so.
TEST(House, EveryFileOfTheEngineIsCompiledForTheSameBits) {
  std::ifstream file(binary / "compile_commands.json");
  ASSERT_TRUE(file) << binary;
  int checked = 0;
  for (std::string line; std::getline(file, line);) {
    if (line.find("\"command\"") == std::string::npos || line.find("/engine/") == std::string::npos) continue;
    for (const char* flag : {"-ffp-contract=off", "-fno-fast-math", "-mno-fma", "-DEIGEN_DONT_VECTORIZE"}) {
      EXPECT_NE(line.find(flag), std::string::npos) << flag << ": " << line;
    }
    for (const char* flag : {" -ffast-math", "-Ofast", "-march=", "-mfma", "-funsafe-math"}) {
      EXPECT_EQ(line.find(flag), std::string::npos) << flag << ": " << line;
    }
    ++checked;
  }
  EXPECT_GT(checked, 30);
}

TEST(House, TheEngineCallsNoFunctionOfTheMathLibrary) {
  for (const fs::path& library : engine_libraries()) {
    const std::string symbols = run("nm -u '" + library.string() + "' | awk '{print $2}' | sort -u");
    EXPECT_FALSE(symbols.empty()) << library;
    for (const char* name :
         {"sin",  "cos",   "tan", "asin", "acos",  "atan", "atan2", "exp",  "exp2",   "expm1", "log",
          "log2", "log10", "pow", "cbrt", "hypot", "sinh", "cosh",  "tanh", "sincos", "fma"}) {
      for (const char* suffix : {"\n", "f\n"}) {
        EXPECT_EQ(("\n" + symbols).find("\n" + std::string(name) + suffix), std::string::npos)
            << library << ' ' << name;
      }
    }
  }
}

// Its supernodal module is under the GPL (docs/licences.md).
TEST(House, TheCommandDoesNotLinkCholmod) {
  const std::string libraries = run("objdump -p '" SULCUS_COMMAND "' | grep NEEDED");
  EXPECT_NE(libraries.find("libhdf5"), std::string::npos) << libraries;
  EXPECT_EQ(libraries.find("libcholmod"), std::string::npos) << libraries;
}

TEST(House, NoFloatingPointReductionOrAtomicOfOpenMp) {
  for (const auto& entry : fs::recursive_directory_iterator(source / "engine")) {
    if (entry.path().extension() != ".cpp" && entry.path().extension() != ".h") continue;
    std::ifstream file(entry.path());
    for (std::string line; std::getline(file, line);) {
      if (line.find("#pragma omp") == std::string::npos) continue;
      for (const char* word : {"atomic", "critical", "dynamic", "guided", "nowait"}) {
        EXPECT_EQ(line.find(word), std::string::npos) << entry.path() << ": " << line;
      }
      // sums of whole numbers and boolean operations do not depend on their order; write "reduction(+ :
      // count)"
      EXPECT_TRUE(line.find("reduction") == std::string::npos ||
                  line.find("// whole numbers") != std::string::npos)
          << entry.path() << ": " << line;
    }
  }
}

TEST(House, NoFileIsLongerThanAReaderCanHold) {
  for (const char* room : {"engine", "device_sim", "hw_phantom", "scenarios", "verify", "tools"}) {
    for (const auto& entry : fs::recursive_directory_iterator(source / room)) {
      if (entry.path().extension() != ".cpp" && entry.path().extension() != ".h") continue;
      std::ifstream file(entry.path());
      const auto lines =
          std::count(std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>(), '\n');
      EXPECT_LE(lines, 700) << entry.path();
    }
  }
}

TEST(House, TheBackEndInTheDocsIsTheOneThatIsTestedAndShort) {
  const auto text = [](const char* file) {
    std::ifstream stream(source / file);
    return std::string(std::istreambuf_iterator<char>(stream), {});
  };
  const std::string example = text("device_sim/test_metronome.h");
  EXPECT_NE(text("docs/devices.md").find("```cpp\n" + example + "```\n"), std::string::npos);
  EXPECT_NE(text("device_sim/conformance_test.cpp").find("make_unique<Metronome>"), std::string::npos);
  EXPECT_GT(example.size(), 0u);
  EXPECT_LT(std::count(example.begin(), example.end(), '\n'), 100);
}

TEST(House, GoldenDataStaySmall) {
  std::uintmax_t all = 0;
  for (const auto& scenario : fs::directory_iterator(source / "golden")) {
    if (!scenario.is_directory()) continue;
    std::uintmax_t bytes = 0;
    for (const auto& file : fs::directory_iterator(scenario.path())) bytes += file.file_size();
    EXPECT_LE(bytes, 300'000u) << scenario.path();
    all += bytes;
  }
  EXPECT_GT(all, 0u);
  EXPECT_LE(all, 10'000'000u);
}

}  // namespace
