// Rows that only one of two stacks has request the motion of the other stack, or a point on the way there, ahead of
// their solve:
//
//   b' = J x_other + k (b - J x_other),    k = h^p for a new row, (1 - h)^p for a leaving one,    p = 3/4
//
// the intermediate desired value of Lee, Mansard and Park (2012).  A task that is far from its target is out of reach
// at once; its answer is costly to find, and more than a transition can use.  Answers are blended all the same, by so
// much that the row gets h b + (1 - h) J x_other or its mirror image, as it does without this.
#pragma once

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "line.hpp"

namespace hqp {

// Elements that only one of two stacks has; second: true if the second one has them.  pull: for each row, if its b is
// linear in the error of the element, else empty.
struct Eased {
  bool second = false;
  std::vector<std::string> names;
  std::vector<std::vector<double>> pull;

  template <class Node>
  static Eased of(const Node& p) {
    Eased found{p.flag("second"), p.texts("names"), {}};
    for (const Node& one : p.parts("pull")) found.pull.push_back(one.numbers());
    if (found.pull.size() != found.names.size())
      throw PlanError("a transition eases " + std::to_string(found.names.size()) + " elements, with numbers of " +
                      std::to_string(found.pull.size()) + ": export it anew");
    return found;
  }
};

class Easing final : public SolveCall {
 public:
  static constexpr double kExponent = 0.75;  // p: at 1 nothing is blended, and differences of two stacks jump

  Easing(const Line& line, const Eased& eased)
      : n_(std::size_t(line.size())), second_(eased.second), next_(line.solver()) {
    whole_ = true, stands_ = !eased.second;
    for (std::size_t k = 0; k < eased.names.size(); ++k) {
      const std::vector<Member>& members = line.members();
      std::size_t m = 0;
      while (m < members.size() && members[m].name != eased.names[k]) ++m;
      if (m == members.size() || members[m].level < 0)
        throw PlanError("a transition eases '" + eased.names[k] + "', which has no rows in its stack: export it anew");
      const Member& member = members[m];
      const Level& level = line.levels()[std::size_t(member.level)];
      const std::size_t count = std::size_t(member.last - member.first);
      const std::vector<double>& pull = eased.pull[k];
      if (!pull.empty() && (pull.size() != count || std::size_t(member.row_end - member.row) != count))
        throw PlanError("a transition eases '" + eased.names[k] + "' by " + std::to_string(pull.size()) +
                        " numbers, needed " + std::to_string(count) + ": export it anew");
      elements_.push_back(m), stands_ = stands_ && !pull.empty();
      if (!level.A) {
        whole_ = false;
        continue;
      }
      parts_.push_back({count, level.A + std::size_t(member.first) * n_,
                        const_cast<double*>(level.lower) + member.first,
                        const_cast<double*>(level.upper) + member.first, line.error(member), pull});
    }
    stands_ = stands_ && whole_;
  }

  bool second() const { return second_; }
  // Return true if the rows can be without their error: see here.
  bool stands() const { return stands_; }
  const std::vector<std::size_t>& elements() const { return elements_; }  // indices in their stack

  // Request that share of the way from the other stack's answer (n).  here: b without the error, so that a contact on
  // its way out is held where it is, not where it was.
  void aim(const double* other, double h, bool here) {
    other_.assign(other, other + n_);
    k_ = whole_ ? std::pow(second_ ? h : 1.0 - h, kExponent) : 1.0;
    here_ = here;
  }
  // Share of the second answer in the blend at h, and the h at such a share.
  double weight(double h) const {
    if (second_) return k_ > 0.0 ? std::min(1.0, h / k_) : 0.0;
    return k_ > 0.0 ? std::max(0.0, 1.0 - (1.0 - h) / k_) : 1.0;
  }
  double share(double weight) const { return second_ ? weight * k_ : 1.0 - (1.0 - weight) * k_; }

  // The rows, then the solver.
  Solved run(const double* v) override {
    if (whole_ && !other_.empty() && (k_ != 1.0 || here_)) rewrite();
    return next_ ? next_->run(v) : Solved{kAskPython};
  }

 private:
  struct Part {
    std::size_t m;
    const double* A;
    double *lower, *upper;
    const double* error;
    std::vector<double> pull;
  };

  void rewrite() {
    for (const Part& p : parts_) {
      if (p.m == 0 || !(p.lower[0] > -INFINITY)) continue;  // left out of this tick
      for (std::size_t i = 0; i < p.m; ++i) {
        if (here_ && !p.pull.empty()) p.upper[i] = p.lower[i] += p.pull[i] * p.error[i];
        double there = 0.0;
        for (std::size_t j = 0; j < n_; ++j) there += p.A[i * n_ + j] * other_[j];
        there *= 1.0 - k_;
        p.lower[i] = k_ * p.lower[i] + there;
        p.upper[i] = k_ * p.upper[i] + there;
      }
    }
  }

  std::size_t n_;
  bool second_, whole_, stands_, here_ = false;
  SolveCall* next_;
  std::vector<std::size_t> elements_;
  std::vector<Part> parts_;
  std::vector<double> other_;
  double k_ = 1.0;
};

}  // namespace hqp
