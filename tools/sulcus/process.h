// Other programs, started and waited for.
#pragma once

#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

namespace sulcus {

// The program that runs now.
std::filesystem::path own_program();

// Runs `arguments` (the first is the program, searched in PATH if it has no '/') with standard output and
// error into the file `log`, appended. Returns its exit code, 128 + number of the signal that ended it, or
// 127 if there is no such program. The child's threads give their cores away while they wait. Throws
// EnvironmentError if nothing can be started or `log` cannot be opened.
int run_program(const std::vector<std::string>& arguments, const std::filesystem::path& log);

// A program with pipes to its standard input and from its standard output; its standard error is ours. The
// end of this closes both and waits for it.
class PipedProgram {
 public:
  explicit PipedProgram(const std::vector<std::string>& arguments);  // throws EnvironmentError
  ~PipedProgram();
  PipedProgram(const PipedProgram&) = delete;
  PipedProgram& operator=(const PipedProgram&) = delete;
  std::FILE* to() const { return to_; }
  std::FILE* from() const { return from_; }

 private:
  int child_ = 0;
  std::FILE *to_ = nullptr, *from_ = nullptr;
};

// What a program wrote last: the last line of a file that is not empty.
std::string last_line(const std::filesystem::path& file);

}  // namespace sulcus
