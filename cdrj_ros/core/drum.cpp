#include "drum.hpp"

namespace cdrj {
namespace {

/// Keep every other break point and the last one; returns how many are left.
int thin_out(Drum& drum) {
    const int n = static_cast<int>(drum.points);
    int kept = 0;
    for (int k = 0; k < n - 1; k += 2) {
        drum.angle[kept] = drum.angle[k];
        drum.material[kept] = drum.material[k];
        ++kept;
    }
    drum.angle[kept] = drum.angle[n - 1];
    drum.material[kept] = drum.material[n - 1];
    drum.spacing *= 2.0;
    return kept + 1;
}

}  // namespace

double turn_drum(Drum& drum, double angle, double rate) {
    int n = static_cast<int>(drum.points);
    int top = n - 1;
    if (angle >= drum.angle[top]) {
        const double material = drum.material[top] + rate * (angle - drum.angle[top]);
        if (top > 0 && angle - drum.angle[top - 1] <= drum.spacing) {
            drum.angle[top] = angle;
            drum.material[top] = material;
            return material;
        }
        if (n == CAPACITY) n = thin_out(drum);
        drum.angle[n] = angle;
        drum.material[n] = material;
        drum.points = n + 1.0;
        return material;
    }
    while (top > 0 && angle <= drum.angle[top - 1]) --top;
    double material;
    if (top == 0) {
        material = drum.material[0] + drum.rate_below * (angle - drum.angle[0]);
    } else {
        const int below = top - 1;
        const double share = (angle - drum.angle[below]) / (drum.angle[top] - drum.angle[below]);
        material = drum.material[below] + share * (drum.material[top] - drum.material[below]);
    }
    drum.angle[top] = angle;
    drum.material[top] = material;
    drum.points = top + 1.0;
    return material;
}

}  // namespace cdrj
