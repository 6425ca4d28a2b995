// Which element holds which back, from the multipliers of the kernel and of the stages: a few products of what the
// latest solve left behind.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "coordinates.hpp"
#include "stage_search.hpp"
#include "stages.hpp"

namespace hqp {
inline namespace HQP_ISA {

constexpr double kUnmet = 1e-9;  // ||w|| below this, relative to 1 + what was asked, has no account

// How a stage ended: rows held (as numbered by StageRows), their multipliers in A'u + c y = sum lambda_i c_i.
struct StageEnd {
  bool known = false;
  std::vector<int> rows;
  std::vector<double> lambda;
};

class Accounts {
 public:
  explicit Accounts(int n) : n_(n), g_(padded(n)), y_(padded(n)), b_(padded(n)), end_(padded(n)) {}

  // numbers (elements, 4): ||w||, ||w|| at the point of least motion, ||A'w||, the largest that A'w could be.
  // shares (levels, elements + 1): of level k's push g = A_k'w what each element above holds, its price last, each
  // divided by their sum; zero where the level is met.  worth (levels): c ||y_k||, what more motion would bring.
  // held: rows of unit length in motion coordinates; row_of: the row of the problem that each stands for. What a row
  // holds counts for the price where it binds in the stage alone, and further than rows.near from rest.
  void run(const std::vector<PricedLevel>& levels, const std::vector<Handed>& handed, const Coordinates& at,
           const double* prices, const std::vector<StageEnd>& ends, const StageRows& held,
           const std::vector<int>& row_of, const AccountRows& rows, double* numbers, double* shares, double* worth) {
    const int elements = rows.elements, width = elements + 1;
    std::fill(numbers, numbers + 4 * elements, 0.0);
    std::fill(shares, shares + levels.size() * width, 0.0);
    std::fill(worth, worth + levels.size(), 0.0);
    const double* lambda = rows.lambda;
    int start = 0, before = 0;
    at.motion(rows.x, end_.data());
    for (std::size_t k = 0; k < levels.size(); ++k) {
      const PricedLevel& level = levels[k];
      const double* w = rows.w + start;
      const std::int32_t* owner = rows.owner + start;
      const bool priced = prices && prices[k] > 0.0;
      double square = 0.0, asked = 0.0;
      for (int i = 0; i < level.m; ++i) {
        const double off = slack(product(level, i, at.still()), level.lower[i], level.upper[i]);
        double* out = numbers + 4 * owner[i];
        out[0] += w[i] * w[i];
        out[1] += off * off;
        square += w[i] * w[i];
        asked += off * off;
      }
      if (std::sqrt(square) > kUnmet * (1.0 + std::sqrt(asked))) {
        push(level, at, w, owner, numbers);
        double* mine = shares + k * width;
        if (priced && ends[k].known) {
          at.motion(rows.stages + k * n_, y_.data());
          worth[k] = prices[k] * std::sqrt(dot_any(y_.data(), y_.data(), n_));
          mine[elements] = -prices[k] * dot_any(g_.data(), y_.data(), n_);
          for (std::size_t q = 0; q < ends[k].rows.size(); ++q) {
            const int row = ends[k].rows[q];
            if (row >= static_cast<int>(row_of.size())) continue;  // the level's own
            const double force = ends[k].lambda[q] * dot_any(g_.data(), held.row(row), n_);
            const bool counts = equality(levels, row_of[row]) || holds(held, row, ends[k].lambda[q], rows.near);
            mine[counts ? rows.owner[row_of[row]] : elements] += force;
          }
        } else if (!priced && lambda) {
          at.step(g_.data(), y_.data());
          by_kernel(levels, handed, prices, k, lambda, rows, mine);
        }
        double sum = 0.0;
        for (int e = 0; e < width; ++e) sum += larger(mine[e], 0.0);  // an element may also push the level's way
        for (int e = 0; e < width; ++e) mine[e] = sum > 0.0 ? larger(mine[e], 0.0) / sum : 0.0;
      }
      start += level.m;
      before += level.m + (rows.guards && priced ? 1 : 0);
      if (lambda) lambda += before;
    }
    for (int e = 0; e < elements; ++e) {
      double* out = numbers + 4 * e;
      for (int c : {0, 1, 3}) out[c] = std::sqrt(out[c]);
      out[3] *= out[0];
    }
  }

 private:
  static bool equality(const std::vector<PricedLevel>& levels, int row) {
    for (const PricedLevel& level : levels) {
      if (row < level.m) return level.lower[row] == level.upper[row];
      row -= level.m;
    }
    return true;
  }

  bool holds(const StageRows& held, int row, double lambda, double near) const {
    const double bound = lambda > 0.0 ? held.lower[row] : held.upper[row];
    return std::abs(bound) <= near ||
           std::abs(held.value(row, end_.data(), n_) - bound) <= 1e-9 * (1.0 + std::abs(bound));
  }

  double product(const PricedLevel& level, int i, const double* x) const {
    if (!level.A) return level.scale[i] * x[level.index[i]];
    return dot_any(level.A + static_cast<std::size_t>(i) * n_, x, n_);
  }

  // g_ = A'w in motion coordinates; ||A'w|| of each element, and the sum of its rows' squares, in those of x.
  void push(const PricedLevel& level, const Coordinates& at, const double* w, const std::int32_t* owner,
            double* numbers) {
    std::fill(b_.begin(), b_.end(), 0.0);
    for (int i = 0; i < level.m;) {
      const int e = owner[i];
      std::fill(y_.begin(), y_.end(), 0.0);
      double size = 0.0;
      for (; i < level.m && owner[i] == e; ++i) {
        if (w[i] == 0.0) continue;
        if (level.A) {
          const double* a = level.A + static_cast<std::size_t>(i) * n_;
          size += dot_any(a, a, n_);
          add_any(y_.data(), a, w[i], n_);
        } else {
          size += level.scale[i] * level.scale[i];
          y_[level.index[i]] += level.scale[i] * w[i];
        }
      }
      numbers[4 * e + 2] = std::sqrt(dot_any(y_.data(), y_.data(), n_));
      numbers[4 * e + 3] = size;
      add_any(b_.data(), y_.data(), 1.0, n_);
    }
    at.row(b_.data(), g_.data());
  }

  // Of exact level k, whose push along the step y_ the rows above hold by A'w = -sum lambda_i a_i; a guard counts for
  // the first element of its level.
  void by_kernel(const std::vector<PricedLevel>& levels, const std::vector<Handed>& handed, const double* prices,
                 std::size_t k, const double* lambda, const AccountRows& rows, double* mine) {
    const std::int32_t* owner = rows.owner;
    for (std::size_t j = 0; j < k; ++j) {
      const PricedLevel& level = levels[j];
      for (int i = 0; i < level.m; ++i)
        if (lambda[i] != 0.0) mine[owner[i]] -= lambda[i] * product(level, i, y_.data());
      lambda += level.m;
      if (rows.guards && prices && prices[j] > 0.0) {
        const double* guard = handed[j].A + static_cast<std::size_t>(level.m) * n_;
        if (*lambda != 0.0 && level.m) mine[owner[0]] -= *lambda * dot_any(guard, y_.data(), n_);
        ++lambda;
      }
      owner += level.m;
    }
  }

  int n_;
  std::vector<double> g_, y_, b_, end_;
};

}  // namespace HQP_ISA
}  // namespace hqp
