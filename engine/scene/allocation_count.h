// For tests: how often the program has asked for memory since it started.
#pragma once

namespace sulcus {

long allocation_count();

}  // namespace sulcus
