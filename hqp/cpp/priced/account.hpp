// Shares by which elements hold each other back, from the multipliers of the kernel and of the stages: a few products
// with results of the latest solve.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "anchors.hpp"
#include "priced_rows.hpp"
#include "stages.hpp"

namespace hqp {
inline namespace HQP_ISA {

// End of a stage: active rows of higher levels, by their number among all rows, their multipliers in
// A_k'u + c grad E + grad R_k = sum lambda_i a_i, and a flag for equalities.
struct StageEnd {
  bool known = false;
  std::vector<int> rows;
  std::vector<double> lambda;
  std::vector<char> firm;
};

class Accounts {
 public:
  Accounts(int n, const std::vector<PricedLevel>& levels)
      : n_(n), level_(levels), g_(padded(n)), y_(padded(n)), b_(padded(n)), step_(padded(n)) {}

  // numbers (elements, 4): ||w||, ||w|| at the point of least motion, ||A'w||, the largest that A'w could be.
  // shares (levels, elements + 1): parts of level k's push A_k'w that each higher element holds, its price last, each
  // divided by their sum; zero if the level is met.  worth (levels): c ||y_k||, the gain by more motion.
  // A row's part counts for the price if the row binds in the stage alone, and further than rows.near from rest.
  void run(Motions& motions, const double* prices, const std::vector<StageEnd>& ends,
           const std::vector<Anchor>& anchors, const AccountRows& rows, double* numbers, double* shares,
           double* worth) {
    const Coordinates& at = motions.base();
    const int elements = rows.elements, width = elements + 1;
    std::fill(numbers, numbers + 4 * elements, 0.0);
    std::fill(shares, shares + level_.size() * width, 0.0);
    std::fill(worth, worth + level_.size(), 0.0);
    const double* lambda = rows.lambda;
    std::size_t multipliers = rows.multipliers;
    int start = 0;
    for (std::size_t k = 0; k < level_.size(); ++k) {
      const PricedLevel& level = level_[k];
      const double* w = rows.w + start;
      const std::int32_t* owner = rows.owner + start;
      const bool priced = prices && prices[k] > 0.0;
      double square = 0.0, demanded = 0.0;
      for (int i = 0; i < level.m; ++i) {
        const double off = slack(row_value(level, i, at.still(), n_), level.lower[i], level.upper[i]);
        double* out = numbers + 4 * owner[i];
        out[0] += w[i] * w[i];
        out[1] += off * off;
        square += w[i] * w[i];
        demanded += off * off;
      }
      if (std::sqrt(square) > kActive * (1.0 + std::sqrt(demanded))) {
        push(level, at, w, owner, numbers);
        double* mine = shares + k * width;
        const std::size_t all = static_cast<std::size_t>(start + level.m);
        if (ends[k].known) {
          const double* point = priced ? rows.stages + k * n_ : rows.x;
          if (priced) {
            at.motion(point, y_.data());
            worth[k] = prices[k] * std::sqrt(dot_any(y_.data(), y_.data(), n_));
            mine[elements] = -prices[k] * dot_any(g_.data(), y_.data(), n_);
          }
          for (std::size_t q = 0; q < ends[k].rows.size(); ++q) {
            const int row = ends[k].rows[q];
            const double force = ends[k].lambda[q] * product(row, step_.data());
            const bool counts = !priced || ends[k].firm[q] || holds(row, ends[k].lambda[q], rows, at);
            mine[counts ? rows.owner[row] : elements] += force;
          }
          by_anchors(motions, anchors, static_cast<int>(k), point, priced ? prices[k] : 1.0, rows.owner, mine);
        } else if (!priced && multipliers >= all) {
          for (int row = 0; row < start; ++row)
            if (lambda[row] != 0.0) mine[rows.owner[row]] -= lambda[row] * product(row, step_.data());
        }
        double sum = 0.0;
        for (int e = 0; e < width; ++e) sum += larger(mine[e], 0.0);  // an element may also push the level's way
        for (int e = 0; e < width; ++e) mine[e] = sum > 0.0 ? larger(mine[e], 0.0) / sum : 0.0;
      }
      start += level.m;
      const std::size_t passed = std::min(multipliers, static_cast<std::size_t>(start));
      lambda += passed, multipliers -= passed;
    }
    for (int e = 0; e < elements; ++e) {
      double* out = numbers + 4 * e;
      for (int c : {0, 1, 3}) out[c] = std::sqrt(out[c]);
      out[3] *= out[0];
    }
  }

 private:
  // Product of a row, by its number among all, with x.
  double product(int row, const double* x) const {
    std::size_t k = 0;
    while (row >= level_[k].m) row -= level_[k++].m;
    return row_value(level_[k], row, x, n_);
  }

  // Return true if an inequality binds at the answer, or close to rest.
  bool holds(int row, double lambda, const AccountRows& rows, const Coordinates& at) {
    int i = row;
    std::size_t k = 0;
    while (i >= level_[k].m) i -= level_[k++].m;
    const PricedLevel& level = level_[k];
    const double bound = lambda > 0.0 ? level.lower[i] : level.upper[i];
    at.row(coefficients(level, i, n_, y_), b_.data());
    const double length = std::sqrt(dot_any(b_.data(), b_.data(), n_));
    return std::abs(bound - row_value(level, i, at.still(), n_)) <= rows.near * length ||
           std::abs(row_value(level, i, rows.x, n_) - bound) <= kActive * (length + std::abs(bound));
  }

  // g_ = A'w in motion coordinates, step_ = P g_; ||A'w|| of each element, and the sum of its rows' squares, in those
  // of x.
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
    at.step(g_.data(), step_.data());
  }

  // Add the parts that rows of unmet levels above level k hold by motion beyond those levels' points.  price: of
  // motion.
  void by_anchors(Motions& motions, const std::vector<Anchor>& anchors, int k, const double* x, double price,
                  const std::int32_t* owner, double* mine) {
    const int count = motions.count();
    for (const Anchor& anchor : anchors) {
      if (anchor.level >= k || !(anchor.turning > 0.0)) continue;
      beyond_.resize(count);
      for (int j = 0; j < count; ++j)
        beyond_[j] = (motions.moved(j, x) - anchor.from[j]) * motions.moved(j, step_.data());
      for (std::size_t i = 0; i < anchor.held.size(); ++i)
        mine[owner[anchor.first + i]] -=
            price * anchor.turning * dot_any(&anchor.share[i * count], beyond_.data(), count);
    }
  }

  int n_;
  const std::vector<PricedLevel>& level_;
  std::vector<double> g_, y_, b_, step_, beyond_;
};

}  // namespace HQP_ISA
}  // namespace hqp
