// From errors to demands, from ways left to bounds: the laws of all rows of a stack at once; see hqp/declare/law.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

#include "references.hpp"

namespace hqp {

// How rows become bounds on J x: a law on the error, a law on the way left to either bound, bounds as they stand, none
// at all.
enum Kind : std::int8_t { kEquality = 0, kLimited = 1, kBounded = 2, kFree = 3 };

struct Saturation {  // of the rows of one element; damping: its largest kd
  int start, stop;
  double fastest, hardest, damping;
};

struct Laws {  // live arrays, (total,) but for J (m, nv) row-major and the coordinates that the rows after it pick
  int order, m, nv, total;
  const double *J, *error, *rate, *feedforward, *drift, *kp, *kd, *weight;
  const std::intptr_t* pick;
  const std::int8_t* kind;
  double *demand, *lower, *upper;
  std::vector<Saturation> saturations;
};

class Demands {
 public:
  explicit Demands(Laws laws)
      : l_(std::move(laws)), damper_(l_.total), speed_(l_.total), saturation_(l_.total, nullptr) {
    for (const Saturation& s : l_.saturations)
      for (int i = s.start; i < s.stop; ++i) saturation_[i] = &s;
  }
  Demands(const Demands&) = delete;

  const double* demand() const { return l_.demand; }
  const double* error() const { return l_.error; }
  const double* lower() const { return l_.lower; }
  const double* upper() const { return l_.upper; }
  int size() const { return l_.total; }

  // Of rows of J, from first to last.
  double squared(int first, int last) const {
    return hqp::squared(l_.J + static_cast<std::ptrdiff_t>(first) * l_.nv, (last - first) * l_.nv);
  }
  // Whether no bounds are crossed, NaN, or infinite on one side alone.
  bool apart(int first, int last) const {
    for (int i = first; i < last; ++i)
      if (!(l_.upper[i] - l_.lower[i] >= 0.0)) return false;
    return true;
  }

  void run(const double* v) {
    for (int i = 0; i < l_.total; ++i) l_.demand[i] = l_.kp[i] * l_.error[i];
    if (l_.order == 1) {
      for (const Saturation& s : l_.saturations) saturate_first(s);
      for (int i = 0; i < l_.total; ++i) l_.demand[i] = l_.rate[i] - l_.demand[i];
    } else {
      for (int i = 0; i < l_.total; ++i) {
        speed_[i] = speed(i, v);
        damper_[i] = l_.kd[i] * (speed_[i] - l_.rate[i]);
      }
      for (const Saturation& s : l_.saturations) saturate_second(s);
      for (int i = 0; i < l_.total; ++i) l_.demand[i] = l_.feedforward[i] - (l_.demand[i] + damper_[i]) - l_.drift[i];
    }
    for (int i = 0; i < l_.total; ++i) {
      const double w = l_.weight[i];
      if (l_.kind[i] == kFree) {
        l_.demand[i] = 0.0;
        l_.lower[i] = -std::numeric_limits<double>::infinity();
        l_.upper[i] = std::numeric_limits<double>::infinity();
      } else if (l_.kind[i] == kLimited) {
        l_.lower[i] = w * towards(i, l_.lower[i]);
        l_.upper[i] = w * towards(i, l_.upper[i]);
      } else {
        l_.lower[i] = w * (l_.kind[i] == kEquality ? l_.demand[i] : l_.lower[i]);
        l_.upper[i] = l_.kind[i] == kEquality ? l_.lower[i] : w * l_.upper[i];
      }
    }
  }

 private:
  double speed(int i, const double* v) const {  // four sums: one would wait for itself
    if (i >= l_.m) return v[l_.pick[i - l_.m]];
    const double* J = l_.J + static_cast<std::ptrdiff_t>(i) * l_.nv;
    double sum[4] = {};
    int c = 0;
    for (; c + 4 <= l_.nv; c += 4)
      for (int k = 0; k < 4; ++k) sum[k] += J[c + k] * v[c + k];
    for (; c < l_.nv; ++c) sum[0] += J[c] * v[c];
    return ((sum[0] + sum[1]) + (sum[2] + sum[3])) / l_.weight[i];
  }
  static double norm(const double* a, int start, int stop) {
    double square = 0.0;
    for (int i = start; i < stop; ++i) square += a[i] * a[i];
    return std::sqrt(square);
  }
  static void scale(double* a, const Saturation& s, double factor) {
    for (int i = s.start; i < s.stop; ++i) a[i] *= factor;
  }

  // The law of a row whose value may still go `way`: its error is -way. No bound, an infinite way, is none after it.
  double towards(int i, double way) const {
    const Saturation* s = saturation_[i];
    double pull = std::isinf(way) ? way : l_.kp[i] * way;
    if (l_.order == 1) {
      if (s) pull = held(pull, std::min(s->fastest, std::isinf(s->hardest) ? s->hardest : reach(s->hardest, way)));
      return l_.rate[i] + pull;
    }
    if (s && std::isfinite(s->fastest)) pull = held(pull, s->damping * s->fastest);
    const double feedback = pull - l_.kd[i] * (speed_[i] - l_.rate[i]);
    return l_.feedforward[i] + (s ? held(feedback, s->hardest) : feedback) - l_.drift[i];
  }
  static double held(double x, double bound) { return std::min(std::max(x, -bound), bound); }
  static double reach(double hardest, double way) { return std::sqrt(2.0 * hardest * std::fabs(way)); }

  void saturate_first(const Saturation& s) {
    const double fast = norm(l_.demand, s.start, s.stop), far = norm(l_.error, s.start, s.stop);
    const double allowed = std::min(s.fastest, std::sqrt(2.0 * s.hardest * far));
    if (fast > allowed) scale(l_.demand, s, allowed / fast);
  }
  void saturate_second(const Saturation& s) {
    const double pull = norm(l_.demand, s.start, s.stop);
    if (pull > s.damping * s.fastest) scale(l_.demand, s, s.damping * s.fastest / pull);
    double square = 0.0;
    for (int i = s.start; i < s.stop; ++i) square += (l_.demand[i] + damper_[i]) * (l_.demand[i] + damper_[i]);
    const double size = std::sqrt(square);
    if (!(size > s.hardest)) return;
    scale(l_.demand, s, s.hardest / size);
    scale(damper_.data(), s, s.hardest / size);
  }

  Laws l_;
  std::vector<double> damper_, speed_;
  std::vector<const Saturation*> saturation_;  // of each row, null for none
};

}  // namespace hqp
