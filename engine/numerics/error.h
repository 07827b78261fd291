// How Sulcus says that something is wrong. Three kinds, one for each reader:
//   assert      a defect of Sulcus itself; stays on in release builds
//   InputError  the input is wrong (exit code 2): a file, a key, a number
//   EnvironmentError  the surroundings failed (exit code 3): full disk, read-only place, missing device
// A message names the place, what was found, what was expected, and the remedy, in one sentence or two:
//   "scenario.json: /tissue/default/youngs_modulus_Pa is -5; give a positive number in Pa"
// Nothing in step() throws.
#pragma once

#include <stdexcept>
#include <string>

namespace sulcus {

struct InputError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

struct EnvironmentError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

}  // namespace sulcus
