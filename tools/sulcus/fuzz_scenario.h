// A random scenario, a function of its seed alone.
#pragma once

#include <cstdint>
#include <string>

namespace sulcus {

// A block of several tissues with holes and fissures, that may tear; a ball or a spatula whose hand wanders
// in it (Ornstein-Uhlenbeck), with the faults of a device written into its way (samples that are lost, stuck
// or coarse), goes away and rests. Random choices are made with integers, so that every machine writes the
// same text.
std::string fuzz_scenario(std::uint64_t seed);

}  // namespace sulcus
