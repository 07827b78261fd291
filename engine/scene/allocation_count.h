// For tests: how often the program has asked for memory since it started, and how much it holds.
#pragma once

namespace sulcus {

long allocation_count();
long bytes_held();  // by operator new, as the allocator rounds them

}  // namespace sulcus
