// From errors to demands: the laws of all rows of a stack at once; see hqp/law.py and hqp/assembly.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

namespace hqp {

struct Saturation {  // of the rows of one element; damping: its largest kd
  int start, stop;
  double fastest, hardest, damping;
};

struct Laws {  // live arrays, (total,) but for J (m, nv) row-major and the coordinates that the rows after it pick
  int order, m, nv, total;
  const double *J, *error, *rate, *feedforward, *drift, *kp, *kd, *weight;
  const std::intptr_t* pick;
  const bool* equality;
  double *demand, *lower, *upper;
  std::vector<Saturation> saturations;
};

class Demands {
 public:
  explicit Demands(Laws laws) : l_(std::move(laws)), damper_(l_.total) {}

  void run(const double* v) {
    for (int i = 0; i < l_.total; ++i) l_.demand[i] = l_.kp[i] * l_.error[i];
    if (l_.order == 1) {
      for (const Saturation& s : l_.saturations) saturate_first(s);
      for (int i = 0; i < l_.total; ++i) l_.demand[i] = l_.rate[i] - l_.demand[i];
    } else {
      for (int i = 0; i < l_.total; ++i) damper_[i] = l_.kd[i] * (speed(i, v) - l_.rate[i]);
      for (const Saturation& s : l_.saturations) saturate_second(s);
      for (int i = 0; i < l_.total; ++i) l_.demand[i] = l_.feedforward[i] - (l_.demand[i] + damper_[i]) - l_.drift[i];
    }
    for (int i = 0; i < l_.total; ++i) {
      const double w = l_.weight[i];
      l_.lower[i] = w * (l_.equality[i] ? l_.demand[i] : l_.lower[i]);
      l_.upper[i] = l_.equality[i] ? l_.lower[i] : w * l_.upper[i];
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
  std::vector<double> damper_;
};

}  // namespace hqp
