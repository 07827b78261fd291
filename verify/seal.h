// The seal of a recording: magic, format version, length and XXH3 (128 bits) of all its bytes, in the user
// block before the HDF5 part. It tells a cut or damaged file from a good one before any of it is interpreted.
#pragma once

#include <cstdint>
#include <filesystem>

namespace sulcus {

// Checks the seal and returns the file's length. Throws InputError that says what is wrong.
std::uint64_t check_seal(const std::filesystem::path& path);

// Writes the seal and flushes the file to the disk. Throws EnvironmentError.
void write_seal(const std::filesystem::path& path);

}  // namespace sulcus
