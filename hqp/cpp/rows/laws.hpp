// From errors to demands, from ways left to bounds: the laws of all rows of a stack at once; see hqp/declare/law.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

#include "law_change.hpp"
#include "references.hpp"

namespace hqp {

// Ways from rows to bounds on J x: a law on the error, a law on the way left to either bound, bounds as they stand,
// none at all.
enum Kind : std::int8_t { kEquality = 0, kLimited = 1, kBounded = 2, kFree = 3 };

struct Laws {  // live arrays, (total,) but for J (m, nv) row-major and the coordinates that the rows after it pick
  int order, m, nv, total;
  const double *J, *error, *rate, *feedforward, *drift, *weight;
  const std::intptr_t* pick;
  std::int8_t* kind;
  double *kp, *kd, *demand, *lower, *upper;
  std::vector<Saturation> saturations;
};

class Demands {
 public:
  explicit Demands(Laws laws)
      : l_(std::move(laws)),
        declared_(l_.kind, l_.kind + l_.total),
        damper_(l_.total),
        speed_(l_.total),
        saturation_(l_.total, nullptr) {
    find_saturations();
  }
  Demands(const Demands&) = delete;

  // The rows from start to stop are free from now on, or as declared.
  void free(int start, int stop, bool out) {
    for (int i = start; i < stop; ++i) l_.kind[i] = out ? std::int8_t(kFree) : declared_[std::size_t(i)];
  }

  // A law that the element of its rows may go over to, and its number; the first one, number 0, is the initial law.
  std::size_t add(RowsLaw law) {
    LawChange* known = change(law.held.start, law.held.stop);
    if (!known) {
      known = &changes_.emplace_back(law.held.start, law.held.stop);
      for (auto* each : {&own_, &own_damper_, &pull_, &brake_}) each->resize(std::size_t(l_.total));
      const auto same = [&](const Saturation& s) { return s.start == law.held.start && s.stop == law.held.stop; };
      if (std::none_of(l_.saturations.begin(), l_.saturations.end(), same)) l_.saturations.push_back(law.held);
      find_saturations();
    }
    return known->add(std::move(law));
  }
  // The element of these rows goes over to one of its laws, or has it at once; go_on: by one period.
  void aim(int start, int stop, std::size_t number, bool at_once) {
    LawChange& to = *change(start, stop);
    to.aim(number, at_once);
    std::copy(to.law().kp.begin(), to.law().kp.end(), l_.kp + start);
    std::copy(to.law().kd.begin(), to.law().kd.end(), l_.kd + start);
    for (Saturation& s : l_.saturations)
      if (s.start == start && s.stop == stop) s = to.law().held;
  }
  void go_on(double dt) {
    for (LawChange& each : changes_) each.go_on(dt);
  }

  const double* demand() const { return l_.demand; }
  const double* error() const { return l_.error; }
  const double* lower() const { return l_.lower; }
  const double* upper() const { return l_.upper; }
  int size() const { return l_.total; }

  // Sum of squares of rows of J, from first to last.
  double squared(int first, int last) const {
    return hqp::squared(l_.J + static_cast<std::ptrdiff_t>(first) * l_.nv, (last - first) * l_.nv);
  }
  // Return true if no bounds are crossed, NaN, or infinite on one side alone.
  bool apart(int first, int last) const {
    for (int i = first; i < last; ++i)
      if (!(l_.upper[i] - l_.lower[i] >= 0.0)) return false;
    return true;
  }

  // Speed that the laws of the first m rows remove at no less than a rate, and the deceleration; false for nothing.
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
      mix();
      for (int i = 0; i < l_.total; ++i) l_.demand[i] = l_.rate[i] - l_.demand[i];
    } else {
      for (int i = 0; i < l_.total; ++i) {
        speed_[i] = speed(i, v);
        damper_[i] = l_.kd[i] * (speed_[i] - l_.rate[i]);
      }
      for (const Saturation& s : l_.saturations) saturate_second(s, l_.demand, damper_.data());
      mix();
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

  // The law of a row whose value may still go `way`: its error is -way. An infinite distance has no bound.
  double towards(int i, double way) const {
    double demand = feedback(i, way, l_.kp[i], l_.kd[i], saturation_[i]);
    const double own = demand;
    for (const LawChange& each : changes_)
      if (each.has(i))
        each.beside([&](const RowsLaw& law, const double* share) {
          const std::size_t k = std::size_t(i - law.held.start);
          const double change = feedback(i, way, law.kp[k], law.kd[k], &law.held) - own;
          if (std::isfinite(change)) demand += share[k] * change;  // else one of them knows no bound
        });
    return l_.order == 1 ? l_.rate[i] + demand : l_.feedforward[i] + demand - l_.drift[i];
  }
  double feedback(int i, double way, double kp, double kd, const Saturation* s) const {
    double pull = std::isinf(way) ? way : kp * way;
    if (l_.order == 1)
      return s ? held(pull, std::min(s->fastest, std::isinf(s->hardest) ? s->hardest : reach(s->hardest, way))) : pull;
    if (s && std::isfinite(s->fastest)) pull = held(pull, s->damping * s->fastest);
    const double demand = pull - kd * (speed_[i] - l_.rate[i]);
    return s ? held(demand, s->hardest) : demand;
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
  LawChange* change(int start, int stop) {
    for (LawChange& each : changes_)
      if (each.is_of(start, stop)) return &each;
    return nullptr;
  }
  // Add the demands of the laws beside those of the rows, by their shares.
  void mix() {
    if (std::none_of(changes_.begin(), changes_.end(), [](const LawChange& each) { return each.going(); })) return;
    std::copy_n(l_.demand, l_.total, own_.begin()), own_damper_ = damper_;
    for (const LawChange& each : changes_)
      each.beside([&](const RowsLaw& law, const double* share) {
        const Saturation& held = law.held;
        for (int i = held.start, k = 0; i < held.stop; ++i, ++k) {
          pull_[i] = law.kp[k] * l_.error[i];
          brake_[i] = l_.order == 1 ? 0.0 : law.kd[k] * (speed_[i] - l_.rate[i]);
        }
        if (l_.order == 1) saturate_first(held, pull_.data());
        else saturate_second(held, pull_.data(), brake_.data());
        for (int i = held.start, k = 0; i < held.stop; ++i, ++k) {
          l_.demand[i] += share[k] * (pull_[i] - own_[i]);
          damper_[i] += share[k] * (brake_[i] - own_damper_[i]);
        }
      });
  }

  Laws l_;
  std::vector<std::int8_t> declared_;  // kinds of all rows
  std::vector<double> damper_, speed_;
  std::vector<LawChange> changes_;
  std::vector<double> own_, own_damper_, pull_, brake_;  // used in ticks with other laws as well
  std::vector<const Saturation*> saturation_;            // one per row, null for none
};

}  // namespace hqp
