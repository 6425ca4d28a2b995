// min || sum_a mu_a c_a - t || over mu >= 0: the active set of Lawson and Hanson (1974), chapter 23.
#pragma once

#include "arena.hpp"
#include "deadline.hpp"
#include "dense.hpp"
#include "tolerances.hpp"

namespace hqp {
inline namespace HQP_ISA {

class NonnegativeLeastSquares {
 public:
  int count = 0;                    // columns
  const double** column = nullptr;  // (count,) each of length `size`
  double* sign = nullptr;           // (count,) +1 or -1: c_a = sign_a column_a
  double* mu = nullptr;             // (count,)
  double* rest = nullptr;           // (size,) t - sum_a mu_a c_a
  std::int8_t* passive = nullptr;   // (count,) mu_a > 0
  Deadline* deadline = nullptr;     // if it ends the search, the result is unusable

  void layout(Arena& arena, int n, int most) {
    ld_ = padded(n);
    const std::size_t wide = static_cast<std::size_t>(ld_);
    arena.place(column, most);
    arena.place(sign, most);
    arena.place(mu, most);
    arena.place(passive, most);
    arena.place(order_, n + 1);
    arena.place(skip_, most);
    arena.place(rest, n);
    arena.place(aim_, n + 1);
    arena.place(q_, (n + 1) * wide);
    arena.place(r_, (n + 1) * wide);
    arena.place(along_, n + 1);
    arena.place(t_, n);
  }

  // Returns the length of the rest, infinity after the deadline. At its end c_a' rest <= 0 for every column, up to
  // rounding.
  double solve(const double* t, int size) {
    size_ = size;
    chosen_ = 0;
    double most = 0.0;
    for (int i = 0; i < size; ++i) {
      t_[i] = rest[i] = t[i];
      most = larger(most, std::fabs(t[i]));
    }
    for (int a = 0; a < count; ++a) {
      mu[a] = 0.0;
      passive[a] = skip_[a] = 0;
    }
    const double enough = kLastDigits * most;
    double length = norm(rest);
    for (int turn = 0; turn < 3 * (count + size) && count && !late(); ++turn) {
      int best = -1;
      double most_pull = enough;
      for (int a = 0; a < count; ++a) {
        if (passive[a] || skip_[a]) continue;
        const double pull = sign[a] * dot_any(column[a], rest, size);
        if (pull > most_pull) {
          most_pull = pull;
          best = a;
        }
      }
      if (best < 0) break;
      if (chosen_ == size || !join(best) || aim_[chosen_ - 1] <= 0.0) {  // dependent but for rounding
        if (chosen_ && order_[chosen_ - 1] == best) leave(chosen_ - 1);
        skip_[best] = 1;
        continue;
      }
      back_off();
      const double before = length;
      length = update_rest();
      if (length < before * (1.0 - kNoStep))
        for (int a = 0; a < count; ++a) skip_[a] = 0;
      else skip_[best] = 1;
    }
    return late() ? kInfinity : length;
  }

 private:
  int ld_ = 0, size_ = 0, chosen_ = 0;
  int* order_ = nullptr;  // (chosen,) passive columns in the order of the factor
  std::int8_t* skip_ = nullptr;
  double *q_ = nullptr, *r_ = nullptr, *aim_ = nullptr, *along_ = nullptr,
         *t_ = nullptr;  // columns = Q' R, along = Q t

  bool late() const { return deadline && deadline->passed(); }
  double norm(const double* y) const { return std::sqrt(dot_any(y, y, size_)); }
  double* q(int i) { return q_ + static_cast<std::ptrdiff_t>(i) * ld_; }
  double* r(int i) { return r_ + static_cast<std::ptrdiff_t>(i) * ld_; }  // column i of R

  // Orthogonalise a column against those chosen, twice; false where nothing but rounding is left.
  bool join(int a) {
    double* fresh = q(chosen_);
    double* top = r(chosen_);
    for (int i = 0; i < size_; ++i) fresh[i] = sign[a] * column[a][i];
    const double whole = norm(fresh);
    for (int j = 0; j < chosen_; ++j) top[j] = 0.0;
    for (int pass = 0; pass < 2; ++pass)
      for (int j = 0; j < chosen_; ++j) {
        const double f = dot_any(q(j), fresh, size_);
        top[j] += f;
        add_any(fresh, q(j), -f, size_);
      }
    const double left = norm(fresh);
    if (!(left > kNoRate * whole)) return false;
    top[chosen_] = left;
    for (int i = 0; i < size_; ++i) fresh[i] /= left;
    along_[chosen_] = dot_any(fresh, t_, size_);
    order_[chosen_++] = a;
    passive[a] = 1;
    solve_triangle();
    return true;
  }

  void solve_triangle() {
    for (int i = chosen_ - 1; i >= 0; --i) {
      double s = along_[i];
      for (int j = i + 1; j < chosen_; ++j) s -= r(j)[i] * aim_[j];
      aim_[i] = s / r(i)[i];
    }
  }

  // Drop the column at a place of the factor and orthogonalise the later ones again.
  void leave(int place) {
    const int last = chosen_;
    passive[order_[place]] = 0;
    mu[order_[place]] = 0.0;
    chosen_ = place;
    for (int j = place + 1; j < last && !late(); ++j) {
      const int a = order_[j];
      if (!join(a)) {
        passive[a] = 0;
        mu[a] = 0.0;
      }
    }
    solve_triangle();
  }

  // Towards the least squares over the passive columns, dropping those that turn negative.
  void back_off() {
    while (!late()) {
      double step = 1.0;
      int worst = -1;
      for (int i = 0; i < chosen_; ++i) {
        if (aim_[i] > 0.0) continue;
        const double here = mu[order_[i]], part = here / larger(here - aim_[i], kTiny);
        if (worst < 0 || part < step) {
          step = smaller(part, 1.0);
          worst = i;
        }
      }
      if (worst < 0) break;
      for (int i = 0; i < chosen_; ++i) {
        double& m = mu[order_[i]];
        m = larger(m + step * (aim_[i] - m), 0.0);
      }
      leave(worst);
    }
    for (int i = 0; i < chosen_; ++i) mu[order_[i]] = aim_[i];
  }

  double update_rest() {
    for (int i = 0; i < size_; ++i) rest[i] = t_[i];
    for (int pass = 0; pass < 2; ++pass)
      for (int j = 0; j < chosen_; ++j) add_any(rest, q(j), -dot_any(q(j), rest, size_), size_);
    return norm(rest);
  }
};

}  // namespace HQP_ISA
}  // namespace hqp
