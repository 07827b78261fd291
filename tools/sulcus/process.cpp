#include "tools/sulcus/process.h"

#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <fstream>

#include "engine/numerics/error.h"

namespace sulcus {
namespace fs = std::filesystem;

fs::path own_program() {
  std::error_code error;
  const fs::path program = fs::read_symlink("/proc/self/exe", error);
  if (error) throw EnvironmentError("/proc/self/exe: cannot be read (" + error.message() + "); mount /proc");
  return program;
}

namespace {

std::vector<char*> pointers(const std::vector<std::string>& arguments) {
  std::vector<char*> argv;
  for (const std::string& argument : arguments) argv.push_back(const_cast<char*>(argument.c_str()));
  argv.push_back(nullptr);
  return argv;
}

}  // namespace

int run_program(const std::vector<std::string>& arguments, const fs::path& log) {
  const std::vector<char*> argv = pointers(arguments);
  std::vector<char*> environment;
  char passive[] = "OMP_WAIT_POLICY=passive";
  for (char** entry = environ; *entry != nullptr; ++entry) {
    if (std::strncmp(*entry, "OMP_WAIT_POLICY=", 16) != 0) environment.push_back(*entry);
  }
  environment.push_back(passive);
  environment.push_back(nullptr);

  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, 0, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_addopen(&actions, 1, log.c_str(), O_WRONLY | O_CREAT | O_APPEND, 0666);
  posix_spawn_file_actions_adddup2(&actions, 1, 2);
  pid_t child = 0;
  const int error = posix_spawnp(&child, argv[0], &actions, nullptr, argv.data(), environment.data());
  posix_spawn_file_actions_destroy(&actions);
  if (error == ENOENT && fs::exists(log)) return 127;  // the log could be opened, the program not
  if (error != 0) {
    throw EnvironmentError(arguments[0] + ": cannot be started with output to " + log.string() + " (" +
                           std::strerror(error) + ")");
  }
  int status = 0;
  while (waitpid(child, &status, 0) < 0) {
    if (errno != EINTR) throw EnvironmentError(arguments[0] + ": was lost (" + std::strerror(errno) + ")");
  }
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

PipedProgram::PipedProgram(const std::vector<std::string>& arguments) {
  int in[2], out[2];
  if (pipe2(in, O_CLOEXEC) != 0)
    throw EnvironmentError(std::string("no pipe can be made: ") + std::strerror(errno));
  if (pipe2(out, O_CLOEXEC) != 0) {
    ::close(in[0]);
    ::close(in[1]);
    throw EnvironmentError(std::string("no pipe can be made: ") + std::strerror(errno));
  }
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, in[0], 0);
  posix_spawn_file_actions_adddup2(&actions, out[1], 1);
  const std::vector<char*> argv = pointers(arguments);
  const int error = posix_spawnp(&child_, argv[0], &actions, nullptr, argv.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  ::close(in[0]);
  ::close(out[1]);
  to_ = fdopen(in[1], "w");
  from_ = fdopen(out[0], "r");
  if (error == 0) return;
  std::fclose(to_);
  std::fclose(from_);
  throw EnvironmentError(arguments[0] + ": cannot be started (" + std::strerror(error) + "); give a program");
}

PipedProgram::~PipedProgram() {
  std::fclose(to_);
  std::fclose(from_);
  while (waitpid(child_, nullptr, 0) < 0 && errno == EINTR) {
  }
}

std::string last_line(const fs::path& file) {
  std::ifstream in(file);
  std::string line, last;
  while (std::getline(in, line)) {
    const auto shown = line.rfind('\r');  // of a line of progress, what stands there at the end
    if (shown != std::string::npos) line.erase(0, shown + 1);
    if (!line.empty()) last = line;
  }
  return last;
}

}  // namespace sulcus
