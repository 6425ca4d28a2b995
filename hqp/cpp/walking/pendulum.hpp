// The divergent component of motion of a ZMP that is linear piece by piece. See walking/pendulum.py for the equations.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include "plane.hpp"

namespace hqp {

struct Piece {  // piece of a ZMP in a line
  double duration;
  Vec2 start, end;
};

class DcmPlan {
 public:
  explicit DcmPlan(std::size_t most = 0) { solved_.reserve(most); }

  // Pieces of positive duration that are joined, at least one; no allocation for at most the number that was reserved.
  void plan(const std::vector<Piece>& pieces, double omega) {
    omega_ = omega, duration_ = 0.0;
    solved_.clear();
    for (const Piece& piece : pieces) {
      solved_.push_back({piece.duration, piece.start, (piece.end - piece.start) / piece.duration, {}});
      duration_ += piece.duration;
    }
    Vec2 xi = pieces.back().end;  // the pendulum rests there
    for (std::size_t i = pieces.size(); i-- > 0;) {
      Solved& one = solved_[i];
      const Vec2 rate = one.rate / omega;
      one.diverging = xi - pieces[i].end - rate;
      xi = one.start + rate + std::exp(-omega * one.duration) * one.diverging;
    }
  }
  // ZMP and DCM; before the start those of the start, after the end those of the end.
  std::pair<Vec2, Vec2> at(double time) const {
    double t = std::max(time, 0.0);
    std::size_t k = 0;
    while (t > solved_[k].duration && k + 1 < solved_.size()) t -= solved_[k++].duration;
    const Solved& one = solved_[k];
    t = std::min(t, one.duration);
    const Vec2 zmp = one.start + t * one.rate;
    return {zmp, zmp + one.rate / omega_ + std::exp(-omega_ * (one.duration - t)) * one.diverging};
  }
  double duration() const { return duration_; }

 private:
  struct Solved {
    double duration;
    Vec2 start, rate, diverging;
  };

  std::vector<Solved> solved_;
  double omega_ = 1.0, duration_ = 0.0;
};

}  // namespace hqp
