#include "tools/sulcus/lockstep.h"

#include <csignal>
#include <cstdio>
#include <cstring>
#include <memory>

#include "engine/numerics/error.h"
#include "tools/sulcus/process.h"
#include "tools/sulcus/rerun.h"
#include "tools/sulcus/support.h"
#include "verify/fingerprint.h"

namespace sulcus {
namespace {

constexpr const char* greeting = "sulcus lockstep 1";

std::vector<std::uint64_t> plain(const TreeRow& row) {
  std::vector<std::uint64_t> hashes;
  for (const auto& hash : row) hashes.push_back(hash.value_or(0));
  return hashes;
}

TreeRow row_of(const std::vector<std::uint64_t>& hashes) {
  TreeRow row;
  for (const std::uint64_t hash : hashes) row.push_back(hash == 0 ? std::nullopt : std::optional(hash));
  return row;
}

// The other build, behind its pipes.
class Other {
 public:
  Other(const std::filesystem::path& program, const std::string& recording, int threads)
      : program_(program.string()),
        process_({program.string(), "replay", recording, "--serve-lockstep", "--threads",
                  std::to_string(threads)}) {
    if (line() != greeting + (" " + std::to_string(tree_leaf_names().size())))
      fail("it does not speak lockstep");
    for (const std::string& name : tree_leaf_names()) {
      if (line() != name) fail("it hashes other arrays; build both from sources that know the same ones");
    }
  }
  TreeRow row() {
    std::vector<std::uint64_t> hashes(tree_leaf_names().size());
    read(hashes.data(), hashes.size() * sizeof hashes[0]);
    return row_of(hashes);
  }
  void go_on() { say('n'); }
  void end() { say('q'); }
  LeafArray array(std::size_t leaf) {
    say('d');
    const auto number = static_cast<std::uint32_t>(leaf);
    std::fwrite(&number, sizeof number, 1, process_.to());
    std::fflush(process_.to());
    const std::string head = line();
    LeafArray array;
    array.type = head.substr(0, head.find(' '));
    const unsigned long long bytes = std::strtoull(head.c_str() + array.type.size(), nullptr, 10);
    if (bytes > (1ull << 34)) fail("it sends an array of " + std::to_string(bytes) + " bytes");
    array.bytes.resize(bytes);
    read(array.bytes.data(), array.bytes.size());
    return array;
  }

 private:
  [[noreturn]] void fail(const std::string& what) {
    throw InputError(program_ + ": " + what +
                     "; give another build of sulcus, and a recording that both can read");
  }
  void say(char word) {
    std::fputc(word, process_.to());
    std::fflush(process_.to());
  }
  void read(void* data, std::size_t bytes) {
    if (bytes > 0 && std::fread(data, bytes, 1, process_.from()) != 1) fail("it ended too early");
  }
  std::string line() {
    std::string text;
    for (int c; (c = std::fgetc(process_.from())) != '\n';) {
      if (c == EOF || text.size() > 200) fail("it does not speak lockstep");
      text += static_cast<char>(c);
    }
    return text;
  }

  std::string program_;
  PipedProgram process_;
};

}  // namespace

int serve_lockstep(const RunData& run, const std::string& place, int threads) {
  Rerun again(run, place, threads, true);
  std::printf("%s %zu\n", greeting, tree_leaf_names().size());
  for (const std::string& name : tree_leaf_names()) std::printf("%s\n", name.c_str());
  for (;;) {
    const std::vector<std::uint64_t> hashes = plain(again.row());
    std::fwrite(hashes.data(), sizeof hashes[0], hashes.size(), stdout);
    std::fflush(stdout);
    int word = 0;
    while ((word = std::getchar()) == 'd') {
      std::uint32_t leaf = 0;
      if (std::fread(&leaf, sizeof leaf, 1, stdin) != 1 || leaf >= tree_leaf_names().size()) return 2;
      const LeafArray array = again.array(leaf);
      std::printf("%s %zu\n", array.type.c_str(), array.bytes.size());
      std::fwrite(array.bytes.data(), 1, array.bytes.size(), stdout);
      std::fflush(stdout);
    }
    if (word != 'n' || again.done() == run.steps) return 0;
    again.step();
  }
}

int lockstep(const RunData& run, const std::string& place, int threads,
             const std::filesystem::path& program) {
  std::signal(SIGPIPE, SIG_IGN);  // an end that went away is seen when it is read
  Rerun again(run, place, threads, true);
  Other other(program, place, threads);
  Progress progress(run.header.scenario_name + ": lockstep", run.steps);
  for (;;) {
    const auto differing = differing_leaves(again.row(), other.row());
    if (!differing.empty()) {
      const std::size_t leaf = differing.front();
      std::printf("%s\n%s\n", describe_leaves(differing, again.done(), run.steps).c_str(),
                  describe_difference(tree_leaf_names()[leaf], again.array(leaf), other.array(leaf)).c_str());
      other.end();
      return 1;
    }
    if (again.done() == run.steps) break;
    other.go_on();
    again.step();
    progress.at(again.done());
  }
  other.end();
  std::printf("SAME  %s: %lld steps of both builds, fingerprint %s\n", run.header.scenario_name.c_str(),
              static_cast<long long>(run.steps), hex16(run.fingerprint()).c_str());
  return 0;
}

}  // namespace sulcus
