// Manipulability of a frame; see tasks/manipulability.py for the equations.
#pragma once

#include <array>

#include "rows.hpp"

namespace hqp {

class Manipulability final : public Operation, Rows {  // w = sqrt(det(J J^T)), its gradient; reference (1,)
 public:
  // picked: rows of the frame's Jacobian that count; joints: coordinates that do, of those that move the frame.
  Manipulability(Rows rows, std::vector<int> picked, std::vector<int> joints)
      : Rows(std::move(rows)), picked_(std::move(picked)), joints_(std::move(joints)), columns_(joints_.size()) {}

  void run(const double*, const double*) override {
    const Vec3 p = origin();
    for (std::size_t j = 0; j < joints_.size(); ++j) columns_[j] = column(joints_[j], p);
    double* J = out_.row(0);
    for (const int c : frame_.columns) J[c] = 0.0;
    gram([](const Column& c) -> const Column& { return c; });
    const double square = invert();
    const double w = std::sqrt(std::max(square, 0.0));
    out_.error[0] = w - out_.reference[0];
    if (out_.drift) out_.drift[0] = 0.0;
    if (!(square >= kSingular)) return;
    for (const int i : frame_.columns) {
      const Column own = column(i, p);
      const int start = tree_.bodies()[tree_.owner(i)].first;  // the columns of a ball turn with all of its own
      double turn = 0.0;
      for (std::size_t j = 0; j < joints_.size(); ++j) {
        const Column& other = columns_[j];
        Column change{cross(other.angular, own.linear), {0.0, 0.0, 0.0}};
        if (start <= joints_[j]) change = {cross(own.angular, other.linear), cross(own.angular, other.angular)};
        turn += weighted(change, other);
      }
      J[i] = out_.weight * w * turn;
    }
    if (out_.drift) out_.drift[0] = w * curvature(p);
  }
  bool hold(const double* q, const double* v, double* value) override {
    return hold_value(*this, out_, 1, q, v, value);
  }

 private:
  static constexpr double kSingular = 1e-12;  // determinant below which there is no gradient

  struct Column {
    Vec3 linear, angular;
    double operator[](int row) const { return row < 3 ? linear[row] : angular[row - 3]; }
  };
  using Square = std::array<std::array<double, 6>, 6>;

  Column column(int c, const Vec3& p) const {
    const double* t = tree_.twist(c);
    return {load(t) + cross(load(t + 3), p), load(t + 3)};
  }

  template <typename Pick>
  void gram(Pick pick) {  // J J^T of the rows that count
    const std::size_t k = picked_.size();
    for (std::size_t a = 0; a < k; ++a)
      for (std::size_t b = 0; b <= a; ++b) {
        double sum = 0.0;
        for (const Column& c : columns_) sum += pick(c)[picked_[a]] * pick(c)[picked_[b]];
        inverse_[a][b] = inverse_[b][a] = sum;
      }
  }
  double invert() {  // by sweeps with pivots on the diagonal; returns the determinant, 0 where it is singular
    const std::size_t k = picked_.size();
    double det = 1.0;
    for (std::size_t s = 0; s < k; ++s) {
      const double pivot = inverse_[s][s];
      if (!(pivot > 0.0)) return 0.0;
      det *= pivot;
      for (std::size_t a = 0; a < k; ++a)
        for (std::size_t b = 0; b < k; ++b)
          if (a != s && b != s) inverse_[a][b] -= inverse_[a][s] * inverse_[s][b] / pivot;
      for (std::size_t a = 0; a < k; ++a)
        if (a != s) {
          inverse_[a][s] /= pivot;
          inverse_[s][a] /= -pivot;
        }
      inverse_[s][s] = 1.0 / pivot;
    }
    return det;
  }
  double weighted(const Column& change, const Column& own) const {  // change^T (J J^T)^-1 own
    double sum = 0.0;
    for (std::size_t a = 0; a < picked_.size(); ++a)
      for (std::size_t b = 0; b < picked_.size(); ++b) sum += change[picked_[a]] * inverse_[a][b] * own[picked_[b]];
    return sum;
  }

  // (w'/w)' + (w'/w)^2 by the first two derivatives of the columns: a twist turns with its body, t' = V x t.
  double curvature(const Vec3& p) {
    const std::size_t k = picked_.size();
    const Vec3 rate = motion().at(p), change = tree_.point_drift(frame_.body, p);
    Square first{}, second{};
    for (std::size_t j = 0; j < joints_.size(); ++j) {
      const double* t = tree_.twist(joints_[j]);
      const Motion twist{load(t), load(t + 3)};
      const int body = tree_.owner(joints_[j]);
      const Motion t1 = cross(tree_.motion(body), twist);
      const Motion t2 = cross(tree_.drift(body), twist) + cross(tree_.motion(body), t1);
      const Column own = columns_[j], one{t1.at(p) + cross(twist.angular, rate), t1.angular};
      const Column two{t2.at(p) + 2.0 * cross(t1.angular, rate) + cross(twist.angular, change), t2.angular};
      for (std::size_t a = 0; a < k; ++a)
        for (std::size_t b = 0; b < k; ++b) {
          const int r = picked_[a], s = picked_[b];
          first[a][b] += one[r] * own[s] + own[r] * one[s];
          second[a][b] += two[r] * own[s] + 2.0 * one[r] * one[s] + own[r] * two[s];
        }
    }
    double trace = 0.0, bend = 0.0, twice = 0.0;
    Square turn{};
    for (std::size_t a = 0; a < k; ++a)
      for (std::size_t b = 0; b < k; ++b) {
        for (std::size_t c = 0; c < k; ++c) turn[a][b] += inverse_[a][c] * first[c][b];
        bend += inverse_[a][b] * second[b][a];
      }
    for (std::size_t a = 0; a < k; ++a) {
      trace += turn[a][a];
      for (std::size_t b = 0; b < k; ++b) twice += turn[a][b] * turn[b][a];
    }
    return 0.5 * (bend - twice) + 0.25 * trace * trace;
  }

  std::vector<int> picked_, joints_;
  std::vector<Column> columns_;
  Square inverse_{};
};

}  // namespace hqp
