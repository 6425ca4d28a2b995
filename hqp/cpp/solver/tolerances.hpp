// Tolerances that several algorithms share, all relative; a constant of one algorithm stands beside it.
#pragma once

#include "dense.hpp"

namespace hqp {
inline namespace HQP_ISA {

constexpr double kTiny = 1e-300;           // keeps a quotient finite
constexpr double kSquareRounding = 1e-26;  // a square that is rounding, of the largest
constexpr double kLastDigits = 1e-15;      // rounding of a few operations, of the size of their result
constexpr double kRoundingRow = 2e-15;     // of the longest row: a row no longer has no direction
constexpr double kRounding = 4e-15;        // rounding of a row's terms, and of rows of unit length
constexpr double kNoStep = 1e-14;          // a step that is rounding, of 1 + |x|; steps nearer than this are equal
constexpr double kOnRow = 1e-13;           // rounding of a row's value or of its slack, of its terms
constexpr double kDependent = 1e-13;       // of a row's length: one of which no more is left depends on others
constexpr double kNoRate = 1e-12;          // of a step: a share or a rate of it that is rounding
constexpr double kMultiplierSign = 1e-11;  // of a level's gradient: a smaller multiplier has no sign
constexpr double kMet = 1e-11;             // of a row's length times |x|: a solve meets rows to no less
constexpr double kDirection = 1e-10;       // of a row's length: a row that keeps more adds a direction
constexpr double kAtBound = 1e-10;         // distance of a row from its bound while searching, of its terms
constexpr double kSeen = 1e-9;             // of a row's length: a row does not see what it sees less of
constexpr double kViolated = 1e-8;         // of 1 + |bound|: a constraint off by more is violated; norms differ
constexpr double kUncertain = 1e-6;        // of a row's length: less than this is an uncertain direction

}  // namespace HQP_ISA
}  // namespace hqp
