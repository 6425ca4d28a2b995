// Tolerances that several algorithms share, all relative; a constant of one algorithm stands beside it.
#pragma once

#include "dense.hpp"

namespace hqp {
inline namespace HQP_ISA {

constexpr double kTiny = 1e-300;       // keeps a quotient finite
constexpr double kLastDigits = 1e-15;  // rounding of a few operations, of the size of their result
constexpr double kRounding = 4e-15;    // rounding of a row's terms, of rows of unit length, of the longest row
constexpr double kNoStep = 1e-14;      // a step or a turn that is rounding, of 1 + |x|; steps nearer are equal
constexpr double kOnRow = 1e-13;       // rounding of a row's value, its terms, or the rest that others leave
constexpr double kNoRate = 1e-12;      // share of a step, a gradient, a column, or a row's terms: less is rounding
constexpr double kMet = 1e-11;  // share of a row's length times |x|: a solve, or a hard row, meets rows to no less
constexpr double kDirection = 1e-10;  // share of a row's length: a row that keeps more adds a direction
constexpr double kAtBound = 1e-10;    // distance of a row from its bound while searching, of its terms
constexpr double kSeen = 1e-9;        // share of a row's length: a row does not see what it sees less of
constexpr double kActive = 1e-9;      // share of 1 + |bound| or a gradient: an answer that is so near is there
constexpr double kLost = 1e-8;        // share of a sum: less than this has lost half of its digits, like a root
constexpr double kViolated = 1e-8;    // share of 1 + |bound|, terms or a gradient: an answer off by more is wrong
constexpr double kTurned = 5e-7;      // largest effect of rounding of rows above on a gap
constexpr double kUncertain = 1e-6;   // share of a row's length: less than this is an uncertain direction
constexpr double kClearOf = 1e-5;     // a direction, force or row above this share of the largest is clear of rounding
constexpr double kFreeShare = 1e-5;   // cost of a direction without motion, of the least motion
constexpr double kRests = 1e-3;       // a size below this share of the largest counts as this
constexpr double kEither = 10.0;      // times a threshold: so near it both decisions count; its square is clear
constexpr double kClear = 1e4;        // times the rank tolerance: a pivot no longer than this is doubtful
constexpr int kIdle = 16;             // successive steps without progress that end a search
constexpr int kEnough = 100;          // rounds of an iteration that ends by itself

}  // namespace HQP_ISA
}  // namespace hqp
