// When an element is UNSURE. docs/uncertainty.md.
#pragma once

#include <algorithm>
#include <span>

#include "report.hpp"

namespace cdrj {

/// Set UNSURE on an element's status, unless it is INVALID.
inline void doubt(double& status) {
    const int flags = static_cast<int>(status);
    if ((flags & INVALID) == 0) status = static_cast<double>(flags | UNSURE);
}

/// Set UNSURE where the standard deviation exceeds `share` of the tension or of the preload,
/// whichever is larger.
///
/// `estimate`: tensions, then status of all elements, then the rest. `preload`: of every element's
/// cable [N]. `stddev`: of the tensions, then the rest [N].
inline void mark_unsure(
    std::span<double> estimate, std::span<const double> preload, std::span<const double> stddev,
    double share) {
    const std::size_t elements = preload.size();
    for (std::size_t e = 0; e < elements; ++e) {
        if (stddev[e] > share * std::max(estimate[e], preload[e])) doubt(estimate[elements + e]);
    }
}

}  // namespace cdrj
