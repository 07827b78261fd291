// Two builds of Sulcus run one recording side by side, until a number differs.
//
// The other one is started as `OTHER replay RECORDING --serve-lockstep --threads N` and speaks by its
// standard output: a line "sulcus lockstep 1 <leaves>", the names of the leaves, a line each; then, for the
// start and after every step, the hashes of all leaves (64 bits each, 0: none). It goes on when it reads 'n';
// at 'd' and the number of a leaf (32 bits) it answers with a line "<type> <bytes>" and that array; at 'q' it
// ends.
#pragma once

#include <filesystem>
#include <string>

#include "verify/recording.h"

namespace sulcus {

int serve_lockstep(const RunData& run, const std::string& place, int threads);

// Exit code 0 if all steps are the same, 1 if one differs, which is printed: step, stage, field, index, both
// values. Throws InputError if `other` does not speak as above.
int lockstep(const RunData& run, const std::string& place, int threads, const std::filesystem::path& other);

}  // namespace sulcus
