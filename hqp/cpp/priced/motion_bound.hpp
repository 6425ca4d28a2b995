// Shows that a level is met for its price, from the small motion of the exact answer x, without multipliers.
//
// The least motion E* is convex in the level's targets and u is its gradient: with the targets moved by t along
// u / ||u||, E* rises by t ||u|| at least. x + t p meets them, p being the least motion that moves these targets alone.
// So t ||u|| <= E(x + t p) <= (|y| + t |p|)^2 / 2 with y the motion of x, and for t |p| = r |y|
//   ||u|| <= (1 + r)^2 / (2 r) |y| |p|
// with r at most 1 and so small that no bound becomes active. |p| is at most the length of the level's columns in the
// inverse G of its rows and those above. An inverse of an earlier tick has the error d = |G| |change of the rows|, and
// |p| is longer by 1 / (1 - d) at most.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "coordinates.hpp"
#include "stages.hpp"

namespace hqp {
inline namespace HQP_ISA {

constexpr double kShown = 0.9;    // bound of c ||u|| that shows a level
constexpr double kStale = 0.5;    // d of an inverse to compute anew
constexpr double kNear = 0.12;    // r of coordinates that p does not move
constexpr int kRest = 16;         // ticks without a trial after a bound was too wide
constexpr double kNarrow = 0.05;  // r of others below which the inverse is computed anew

class MotionBound {
 public:
  MotionBound(int n, const std::vector<PricedLevel>& levels)
      : n_(n), level_(levels), room_(n), near_(n), row_(padded(n)) {
    std::size_t most = 1;
    for (const PricedLevel& level : levels) most = std::max<std::size_t>(most, level.m);
    value_.resize(most);
    known_ = std::make_shared<Known>(levels.size());
    for (std::size_t k = 0; k < levels.size(); ++k) {
      Then& then = known_->then[k];
      then.equal.reserve(levels[k].m);
      then.index.reserve(levels[k].m);
      then.rows.reserve(static_cast<std::size_t>(levels[k].m) * n);
      known_->inverse[k].still.reserve(n);
    }
  }

  void forget() {
    if (known_) known_->forget();
  }
  void keep(CarryOver& warm) { warm.part(known_); }

  // x: the exact answer.
  void begin(const Coordinates& coordinates, const double* prices, const double* x) {
    if (!known_) known_ = std::make_shared<Known>(level_.size());
    at_ = &coordinates;
    prices_ = prices;
    x_ = x;
    seen_ = 0;
  }

  // Return true if level k is shown to be met for its price; call from the first level down.
  bool shows(int k) {
    Inverse& inverse = known_->inverse[k];
    inverse.wanted = at_->diagonal() && !inverse.known;
    if (!at_->diagonal() || !inverse.known) return false;
    if (inverse.rest > 0) return --inverse.rest, false;
    see_to(k);
    const double d = inverse.gain * (inverse.age + std::sqrt(changed_)), narrow = least_room(inverse);
    inverse.known = d < kStale;  // false for numbers that are not finite
    inverse.wanted = !inverse.known || (narrow <= kNarrow && inverse.own_gain < INFINITY);
    if (inverse.wanted || !met_ || !equalities_) return false;
    const double r = smaller(narrow, row_room_);
    if (r > 0.0 && prices_[k] * (1.0 + r) * (1.0 + r) * size_ * inverse.own_gain <= kShown * 2.0 * r * (1.0 - d))
      return true;
    inverse.rest = kRest;
    return false;
  }

  // Return true if the latest shows(k) needs an inverse of this tick.
  bool wants(int k) const { return known_->inverse[k].wanted; }

  // Coordinates near a bound of the rows down to level k.
  const std::vector<char>& near(int k) {
    see_to(k);
    for (int j = 0; j < n_; ++j) near_[j] = room_[j] < kNear;
    return near_;
  }

  // Take the inverse for level k with coordinates near() fixed: the length of all its columns, and of the level's.
  void take(int k, double gain, double own_gain) {
    double square = 0.0;
    for (int l = 0; l < static_cast<int>(level_.size()); ++l) {
      if (l <= k) square += keep(l);
      known_->inverse[l].age += std::sqrt(square);
    }
    changed_ = 0.0;
    Inverse& inverse = known_->inverse[k];
    inverse.known = true;
    inverse.age = 0.0;
    inverse.gain = gain;
    inverse.own_gain = own_gain;
    inverse.still = near_;
    inverse.rest = 0;
  }

 private:
  // Former rows of a level in motion coordinates, picking rows by their number; square: sum of their squared change.
  struct Then {
    std::vector<double> rows;
    std::vector<std::int64_t> index;
    std::vector<char> equal;
    double square = INFINITY;
  };

  struct Inverse {
    bool known = false, wanted = false;
    int rest = 0;      // ticks until its next trial
    double age = 0.0;  // largest distance of its rows from the kept ones
    double gain = 0.0, own_gain = 0.0;
    std::vector<char> still;  // fixed coordinates
  };

  // State of each level between ticks.
  struct Known final : WarmPart {
    explicit Known(std::size_t levels) : then(levels), inverse(levels) {}
    std::shared_ptr<WarmPart> another() const override {
      auto made = std::make_shared<Known>(then.size());
      for (std::size_t k = 0; k < then.size(); ++k) {
        made->then[k].equal.reserve(then[k].equal.capacity());
        made->then[k].index.reserve(then[k].index.capacity());
        made->then[k].rows.reserve(then[k].rows.capacity());
        made->inverse[k].still.reserve(inverse[k].still.capacity());
      }
      return made;
    }
    void forget() override {
      for (Inverse& one : inverse) one.known = false;
    }
    void trim() override {
      for (const Inverse& one : inverse)
        if (one.known) return;
      for (Then& one : then) one = Then();
    }
    std::size_t bytes() const override {
      std::size_t sum = sizeof(*this) + bytes_of(then) + bytes_of(inverse);
      for (const Then& one : then) sum += bytes_of(one.rows) + bytes_of(one.index) + bytes_of(one.equal);
      for (const Inverse& one : inverse) sum += bytes_of(one.still);
      return sum;
    }
    std::vector<Then> then;
    std::vector<Inverse> inverse;
  };

  void see_to(int k) {
    if (seen_ == 0) {
      at_->motion(x_, row_.data());
      size_ = std::sqrt(dot_any(row_.data(), row_.data(), n_)) + kUncertain;
      std::fill(room_.begin(), room_.end(), 1.0);
      row_room_ = 1.0;
      changed_ = 0.0;
      met_ = true;
    }
    for (; seen_ <= k; ++seen_) {
      look(level_[seen_], prices_[seen_] > 0.0);
      changed_ += known_->then[seen_].square = change(level_[seen_], known_->then[seen_]);
    }
  }

  // Check that x meets the equalities of a priced level, and measure the room to its bounds.
  void look(const PricedLevel& level, bool priced) {
    equalities_ = true;
    if (level.A) dots_any(x_, level.A, n_, level.m, n_, value_.data());
    for (int i = 0; i < level.m; ++i) {
      const double value = level.A ? value_[i] : level.scale[i] * x_[level.index[i]];
      const double low = level.lower[i], high = level.upper[i];
      if (low == high) {
        met_ = met_ && (!priced || std::abs(value - low) <= kActive * (1.0 + std::abs(value)));
        continue;
      }
      if (level.left_out(i)) continue;
      equalities_ = !priced;
      const double room = smaller(value - low, high - value), reach = size_ * length(level, i);
      double& least = level.A ? row_room_ : room_[level.index[i]];
      if (room < least * reach) least = room / reach;
    }
  }

  double picked(const PricedLevel& level, int i) const {
    return at_->picked(static_cast<int>(level.index[i]), level.scale[i]);
  }

  double length(const PricedLevel& level, int i) {
    if (!level.A) return std::abs(picked(level, i));
    at_->row(level.A + static_cast<std::size_t>(i) * n_, row_.data());
    return std::sqrt(dot_any(row_.data(), row_.data(), n_));
  }

  double change(const PricedLevel& level, const Then& then) const {
    if (then.equal.empty() && level.m > 0) return INFINITY;
    for (int i = 0; i < level.m; ++i)
      if (then.equal[i] != (level.lower[i] == level.upper[i])) return INFINITY;
    if (level.A) return at_->apart(level.A, then.rows.data(), level.m);
    for (int i = 0; i < level.m; ++i)
      if (then.index[i] != level.index[i] || then.rows[i] != picked(level, i)) return INFINITY;
    return 0.0;
  }

  // Keep level l; return the square of its change so far.
  double keep(int l) {
    const PricedLevel& level = level_[l];
    Then& then = known_->then[l];
    then.equal.clear();
    then.rows.clear();
    then.index.clear();
    then.equal.reserve(level.m);
    then.rows.reserve(static_cast<std::size_t>(level.m) * (level.A ? n_ : 1));
    then.index.reserve(level.A ? 0 : level.m);
    for (int i = 0; i < level.m; ++i) {
      then.equal.push_back(level.lower[i] == level.upper[i]);
      if (level.A) {
        at_->row(level.A + static_cast<std::size_t>(i) * n_, row_.data());
        then.rows.insert(then.rows.end(), row_.begin(), row_.begin() + n_);
      } else {
        then.index.push_back(level.index[i]);
        then.rows.push_back(picked(level, i));
      }
    }
    return std::exchange(then.square, 0.0);
  }

  double least_room(const Inverse& inverse) const {
    double room = 1.0;
    for (int j = 0; j < n_; ++j)
      if (!inverse.still[j]) room = smaller(room, room_[j]);
    return room;
  }

  int n_;
  const std::vector<PricedLevel>& level_;
  std::shared_ptr<Known> known_;
  std::vector<double> room_;  // distance of a coordinate to its next bound, relative to |y|, at most 1
  std::vector<char> near_;
  std::vector<double> row_, value_;
  const Coordinates* at_ = nullptr;
  const double *prices_ = nullptr, *x_ = nullptr;
  int seen_ = 0;
  double size_ = 0.0, row_room_ = 1.0,
         changed_ = 0.0;  // row_room_: room of dense rows; changed_: squared change of levels so far
  bool met_ = true, equalities_ = true;
};

}  // namespace HQP_ISA
}  // namespace hqp
