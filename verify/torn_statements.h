// Statements about tissue that tears; part of check_statements.
#pragma once

#include "verify/statements.h"

namespace sulcus {

// torn_stays_torn, manifold, torn_elements (at least, at most), labels_stay: see statements.h.
std::vector<Check> check_torn(const RunData& run, const TornBounds& bounds);

}  // namespace sulcus
