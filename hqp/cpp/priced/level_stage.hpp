// The stage of one level: gather its rows, search, and repeat until directions without motion and slacks cost nothing.
#pragma once

#include <algorithm>
#include <vector>

#include "account.hpp"
#include "gather.hpp"
#include "hand_down.hpp"
#include "stage_search.hpp"

namespace hqp {
inline namespace HQP_ISA {

class LevelStage {
 public:
  LevelStage(PricedRows& levels, const HandDown& above, Motions& motions, int n, const Tolerances& tolerances,
             Deadline& deadline)
      : n_(n),
        levels_(levels),
        above_(above),
        motions_(motions),
        gather_(levels, above, n),
        search_(gather_.rows_of_a_stage(), n, gather_.variables(), levels.most(), tolerances.accurate,
                tolerances.rounded, deadline),
        warm_(levels.count()),
        end_at_(levels.count()),
        ends_(levels.count()) {
    for (auto& set : warm_) set.reserve(levels.total());
    for (auto& x : end_at_) x.reserve(n);
    for (StageEnd& end : ends_) {
      end.rows.reserve(levels.total());
      end.lambda.reserve(levels.total());
      end.firm.reserve(levels.total());
    }
  }

  void begin() {
    iterations_ = 0;
    ended_ = true;
    uncertain_ = inexact_ = undecided_ = false;
    left_ = nullptr;
    for (StageEnd& end : ends_) end.known = false;
  }
  double find_rounding() { return gather_.find_rounding(); }

  // Solve level k over the rows of the levels above, from x (n) to its optimum.  started: true if x is feasible; else
  // return false if the active set of the last tick does not give the optimum.
  bool solve(int k, double price, bool started, std::vector<double>& x) {
    Coordinates& at =
        price > 0.0 ? motions_.among(above_.anchors()) : motions_.over(levels_[k], above_.anchors(), x.data());
    if (!gather_.stage(k, price, at, x.data())) return started;
    double* const y = gather_.y();
    const auto search = [&](bool from_y) {
      gather_.aim_at(at);
      return search_.solve(gather_.rows(), gather_.size(), gather_.aim(), y, warm_[k], iterations_, end_at_[k], from_y);
    };
    bool reached = search(started);
    if (!reached && !started) return false;
    int rounds = 0;  // directions without motion, and slacks, count from where they ended, until that is nothing
    for (; reached && rounds <= kEnough; ++rounds) {
      const bool flat = gather_.flat_counts(at, x.data()), slack = gather_.slacks_count();
      if (!flat && !slack) break;
      if (flat) at.count_flat_from(y);
      if (slack) gather_.count_slacks_from_here();
      reached = search(true);
    }
    ended_ = ended_ && reached;
    uncertain_ = uncertain_ || search_.uncertain() || at.uncertain();
    inexact_ = inexact_ || (reached && search_.strays());
    undecided_ =
        undecided_ || rounds > kEnough || search_.unclear() || (reached && search_.misses(warm_[k], above_.open(), y));
    note(k, reached);
    at.point(y, x.data());
    if (reached) end_at_[k].clear();
    else end_at_[k] = x;
    left_ = leaves(at) ? &at : nullptr;
    return true;
  }

  // Results over all stages since begin().
  int iterations() const { return iterations_; }
  bool ended() const { return ended_; }          // each reached its optimum
  bool uncertain() const { return uncertain_; }  // one met uncertain directions
  bool inexact() const { return inexact_; }      // one may have ended off its optimum by more than rounding
  bool undecided() const { return undecided_; }  // its optimum moves with a reading, or where missed rows are met
  const std::vector<StageEnd>& ends() const { return ends_; }
  // Coordinates of the latest stage if it left a choice, else null.
  const Coordinates* left() const { return left_; }

  void reset() {
    for (auto& set : warm_) set.clear();
    for (auto& x : end_at_) x.clear();
  }
  void keep(CarryOver& warm) {
    for (auto& set : warm_) warm.list(set);
    for (auto& x : end_at_) warm.list(x);
  }

 private:
  // Keep the active rows of higher levels at the end of the stage.
  void note(int k, bool reached) {
    StageEnd& end = ends_[k];
    end.known = reached;
    end.rows.clear();
    end.lambda.clear();
    end.firm.clear();
    for (std::size_t q = 0; q < search_.held().size(); ++q) {
      const int i = search_.held()[q];
      if (i >= gather_.own()) continue;
      end.rows.push_back(gather_.rows()[i].number);
      end.lambda.push_back(search_.multipliers()[q]);
      end.firm.push_back(gather_.rows()[i].equal());
    }
  }
  // Return true if the equalities of the latest search leave a direction that its coordinates do not see.
  bool leaves(const Coordinates& at) const {
    for (int j = 0; j < n_; ++j)
      if (!at.moves(j) && !search_.determines(j)) return true;
    return false;
  }

  int n_, iterations_ = 0;
  bool ended_ = true, uncertain_ = false, inexact_ = false, undecided_ = false;
  PricedRows& levels_;
  const HandDown& above_;
  Motions& motions_;
  Gather gather_;
  StageSearch search_;
  std::vector<std::vector<int>> warm_;
  std::vector<std::vector<double>> end_at_;  // point at which each level's latest stage was cut, empty if it was not
  std::vector<StageEnd> ends_;
  const Coordinates* left_ = nullptr;
};

}  // namespace HQP_ISA
}  // namespace hqp
