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

// A law that an element had before and that still holds by a share of each of its rows; gains and shares, one a row.
struct Former {
  Saturation held;
  std::vector<double> kp, kd, share;
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
    find_saturations();
  }
  Demands(const Demands&) = delete;

  // In place of what held the rows of that element before; bounds without a limit are none.
  void saturate(const Saturation& s) {
    std::vector<Saturation>& known = l_.saturations;
    const auto same = [&](const Saturation& k) { return k.start == s.start && k.stop == s.stop; };
    known.erase(std::remove_if(known.begin(), known.end(), same), known.end());
    if (std::min(s.fastest, s.hardest) < std::numeric_limits<double>::infinity()) known.push_back(s);
    find_saturations();
  }

  // Beside the laws of these rows, in place of what was so before.
  void beside(int start, int stop, std::vector<Former> former) {
    former_.erase(std::remove_if(former_.begin(), former_.end(),
                                 [&](const Former& k) { return k.held.start == start && k.held.stop == stop; }),
                  former_.end());
    for (Former& one : former) former_.push_back(std::move(one));
  }

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

  // What the laws of the first m rows take away of their speeds no slower than at a rate, and with which deceleration;
  // false for nothing.
  bool takes(int m, double rate, double* speed, double* braking) const {
    bool any = false;
    for (int i = 0; i < m; ++i) {
      speed[i] = l_.weight[i] * std::min(1.0, l_.kd[i] / rate) * (speed_[i] - l_.rate[i]);
      braking[i] = l_.kd[i] * speed[i];
      any = any || speed[i] != 0.0;
    }
    return any;
  }

  void run(const double* v) {
    for (int i = 0; i < l_.total; ++i) l_.demand[i] = l_.kp[i] * l_.error[i];
    if (l_.order == 1) {
      for (const Saturation& s : l_.saturations) saturate_first(s, l_.demand);
      if (!former_.empty()) mix();
      for (int i = 0; i < l_.total; ++i) l_.demand[i] = l_.rate[i] - l_.demand[i];
    } else {
      for (int i = 0; i < l_.total; ++i) {
        speed_[i] = speed(i, v);
        damper_[i] = l_.kd[i] * (speed_[i] - l_.rate[i]);
      }
      for (const Saturation& s : l_.saturations) saturate_second(s, l_.demand, damper_.data());
      if (!former_.empty()) mix();
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
  void find_saturations() {
    std::fill(saturation_.begin(), saturation_.end(), nullptr);
    for (const Saturation& s : l_.saturations)
      for (int i = s.start; i < s.stop; ++i) saturation_[i] = &s;
  }
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
    double asked = feedback(i, way, l_.kp[i], l_.kd[i], saturation_[i]);
    const double own = asked;
    for (const Former& f : former_)
      if (f.held.start <= i && i < f.held.stop) {
        const std::size_t k = std::size_t(i - f.held.start);
        const double change = feedback(i, way, f.kp[k], f.kd[k], &f.held) - own;
        if (std::isfinite(change)) asked += f.share[k] * change;  // else one of them knows no bound
      }
    return l_.order == 1 ? l_.rate[i] + asked : l_.feedforward[i] + asked - l_.drift[i];
  }
  double feedback(int i, double way, double kp, double kd, const Saturation* s) const {
    double pull = std::isinf(way) ? way : kp * way;
    if (l_.order == 1)
      return s ? held(pull, std::min(s->fastest, std::isinf(s->hardest) ? s->hardest : reach(s->hardest, way))) : pull;
    if (s && std::isfinite(s->fastest)) pull = held(pull, s->damping * s->fastest);
    const double asked = pull - kd * (speed_[i] - l_.rate[i]);
    return s ? held(asked, s->hardest) : asked;
  }
  static double held(double x, double bound) { return std::min(std::max(x, -bound), bound); }
  static double reach(double hardest, double way) { return std::sqrt(2.0 * hardest * std::fabs(way)); }

  // Arrays of all rows, of which those of one element are held.
  void saturate_first(const Saturation& s, double* pull) const {
    const double fast = norm(pull, s.start, s.stop), far = norm(l_.error, s.start, s.stop);
    const double allowed = std::min(s.fastest, std::sqrt(2.0 * s.hardest * far));
    if (fast > allowed) scale(pull, s, allowed / fast);
  }
  void saturate_second(const Saturation& s, double* pull, double* damper) const {
    const double fast = norm(pull, s.start, s.stop);
    if (fast > s.damping * s.fastest) scale(pull, s, s.damping * s.fastest / fast);
    double square = 0.0;
    for (int i = s.start; i < s.stop; ++i) square += (pull[i] + damper[i]) * (pull[i] + damper[i]);
    const double size = std::sqrt(square);
    if (!(size > s.hardest)) return;
    scale(pull, s, s.hardest / size);
    scale(damper, s, s.hardest / size);
  }
  // What the former laws ask for, by their shares.
  void mix() {
    own_.assign(l_.demand, l_.demand + l_.total), own_damper_ = damper_;
    pull_.resize(own_.size()), brake_.resize(own_.size());
    for (const Former& f : former_) {
      const bool bounded = std::min(f.held.fastest, f.held.hardest) < std::numeric_limits<double>::infinity();
      for (int i = f.held.start, k = 0; i < f.held.stop; ++i, ++k) {
        pull_[i] = f.kp[k] * l_.error[i];
        brake_[i] = l_.order == 1 ? 0.0 : f.kd[k] * (speed_[i] - l_.rate[i]);
      }
      if (bounded && l_.order == 1) saturate_first(f.held, pull_.data());
      if (bounded && l_.order == 2) saturate_second(f.held, pull_.data(), brake_.data());
      for (int i = f.held.start, k = 0; i < f.held.stop; ++i, ++k) {
        l_.demand[i] += f.share[k] * (pull_[i] - own_[i]);
        damper_[i] += f.share[k] * (brake_[i] - own_damper_[i]);
      }
    }
  }

  Laws l_;
  std::vector<double> damper_, speed_;
  std::vector<Former> former_;
  std::vector<double> own_, own_damper_, pull_, brake_;  // of a tick in which former laws hold
  std::vector<const Saturation*> saturation_;            // of each row, null for none
};

}  // namespace hqp
