#include "verify/seal.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>
#include <xxhash.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <memory>
#include <new>
#include <vector>

#include "engine/numerics/error.h"
#include "verify/recording.h"

namespace sulcus {

namespace {

constexpr std::array<char, 8> magic = {'S', 'U', 'L', 'C', 'U', 'S', 'R', 'N'};
constexpr std::size_t block_bytes = 512;  // user block; no sealed file is shorter

// Without padding; the hash goes over the whole file with these 16 bytes as zeros.
struct Seal {
  std::array<char, 8> magic{};
  std::uint32_t version = 0;
  std::uint32_t reserved = 0;
  std::uint64_t length = 0;
  std::uint64_t hash_low = 0, hash_high = 0;
};
static_assert(sizeof(Seal) == 40);

class File {
 public:
  File(const std::filesystem::path& path, int flags) : descriptor_(::open(path.c_str(), flags | O_CLOEXEC)) {}
  ~File() {
    if (descriptor_ >= 0) ::close(descriptor_);
  }
  File(const File&) = delete;
  File& operator=(const File&) = delete;
  operator int() const { return descriptor_; }

 private:
  int descriptor_;
};

// Reads until the buffer is full or the file ends; -1 on an error.
ssize_t read_fully(int file, char* buffer, std::size_t size) {
  std::size_t done = 0;
  while (done < size) {
    const ssize_t got = ::read(file, buffer + done, size - done);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return -1;
    if (got == 0) break;
    done += static_cast<std::size_t>(got);
  }
  return static_cast<ssize_t>(done);
}

// Length and hash of the file from its start; false on an error of reading.
bool measure(int file, std::uint32_t version, Seal& seal) {
  const std::unique_ptr<XXH3_state_t, XXH_errorcode (*)(XXH3_state_t*)> hasher(XXH3_createState(),
                                                                               XXH3_freeState);
  if (!hasher) throw std::bad_alloc();
  XXH3_128bits_reset(hasher.get());
  struct stat status;
  if (::fstat(file, &status) != 0 || ::lseek(file, 0, SEEK_SET) != 0) return false;
  seal = Seal{magic, version, 0, static_cast<std::uint64_t>(status.st_size), 0, 0};

  std::vector<char> buffer(1 << 20);
  bool first = true;
  for (;;) {
    const ssize_t got = read_fully(file, buffer.data(), buffer.size());
    if (got < 0) return false;
    if (got == 0) break;
    if (first && got >= static_cast<ssize_t>(sizeof seal)) std::memcpy(buffer.data(), &seal, sizeof seal);
    first = false;
    XXH3_128bits_update(hasher.get(), buffer.data(), static_cast<std::size_t>(got));
  }
  const XXH128_hash_t hash = XXH3_128bits_digest(hasher.get());
  seal.hash_low = hash.low64;
  seal.hash_high = hash.high64;
  return true;
}

}  // namespace

std::uint64_t check_seal(const std::filesystem::path& path) {
  const auto refuse = [&](const std::string& what) { throw InputError(path.string() + ": " + what); };
  const File file(path, O_RDONLY);
  std::error_code ignored;
  if (file < 0 && errno == ENOENT && std::filesystem::exists(path.string() + ".log", ignored))
    refuse(
        "is not there yet, but its log is: the run or session was cut off, or still goes on; `sulcus "
        "recover " +
        path.parent_path().string() + "` makes a recording of what the log holds");
  if (file < 0)
    refuse(std::string("cannot be opened (") + std::strerror(errno) + "); give the path of a run.h5");
  std::vector<char> block(block_bytes);
  const ssize_t got = read_fully(file, block.data(), block.size());
  if (got < 0)
    refuse(std::string("cannot be read (") + std::strerror(errno) + "); give the path of a run.h5");
  Seal found;
  std::memcpy(&found, block.data(), sizeof found);
  const bool unsealed =
      got > 0 &&
      std::string(block.data(), static_cast<std::size_t>(got)).find_first_not_of('\0') == std::string::npos;
  if (unsealed)
    refuse(
        "is the recording of a run that did not finish; `sulcus recover` makes one of its log, if that "
        "stands "
        "beside it (run.h5.log), else record the run again");
  if (got < static_cast<ssize_t>(block_bytes) || found.magic != magic)
    refuse("is not a recording of Sulcus, or its start is damaged; give the path of a run.h5");
  if (found.version != recording_format_version)
    refuse("has format version " + std::to_string(found.version) + ", this program reads version " +
           std::to_string(recording_format_version) + "; record the run again or use the matching program");
  Seal expected;
  if (!measure(file, found.version, expected)) refuse("cannot be read to its end; check the disk");
  if (found.length != expected.length)
    refuse("has " + std::to_string(expected.length) + " bytes, but was written with " +
           std::to_string(found.length) + " (a cut or damaged copy); copy it again or record the run again");
  if (std::memcmp(&found, &expected, sizeof found) != 0)
    refuse(
        "was changed or damaged after it was written (its seal does not fit its bytes); copy it again or "
        "record "
        "the run again");
  return expected.length;
}

void write_seal(const std::filesystem::path& path) {
  const File file(path, O_RDWR);
  Seal seal;
  bool good = file >= 0 && measure(file, recording_format_version, seal);
  good = good && ::pwrite(file, &seal, sizeof seal, 0) == static_cast<ssize_t>(sizeof seal);
  good = good && ::fsync(file) == 0;
  if (!good)
    throw EnvironmentError(path.string() + ": cannot be sealed (" + std::strerror(errno) +
                           "); free space there or choose another place");
}

void seal_recording(const std::filesystem::path& path) {
  write_seal(path);
}

}  // namespace sulcus
