// Laws that an element has by turns: its demand goes over from the one to the other.
//
//   b = (1 - s) b_old + s b_new,     s from 0 to 1 in a straight line, in 1/k seconds
//
// k [1/s] is the pace of the stiffer of the two laws. So the switch changes the demand by at most k |b_new - b_old| per
// second: no faster than the stiffer law changes it by itself while it closes the error.
#pragma once

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

namespace hqp {

struct Saturation {  // saturation of the rows of one element; damping: its largest kd
  int start, stop;
  double fastest, hardest, damping;
};

struct RowsLaw {  // gains and pace [1/s] of each row
  Saturation held;
  std::vector<double> kp, kd, pace;
};

// The laws of one element by number, and the share of each row by which they hold beside the one that it goes over to.
class LawChange {
 public:
  LawChange(int start, int stop) : start_(start), rows_(std::size_t(stop - start)), pace_(rows_) {}

  bool is_of(int start, int stop) const { return start == start_ && stop == start_ + int(rows_); }
  bool has(int row) const { return row >= start_ && row < start_ + int(rows_); }
  const RowsLaw& law() const { return laws_[law_]; }

  // The first one is the law that the element has. Takes memory, as nothing else here does.
  std::size_t add(RowsLaw law) {
    laws_.push_back(std::move(law));
    former_.reserve(laws_.size());
    before_.resize(laws_.size() * rows_), share_.resize(before_.size());
    return laws_.size() - 1;
  }
  // From now on it goes over to that law, or has it at once.
  void aim(std::size_t law, bool at_once) {
    if (at_once) former_.clear();
    else if (law != law_) leave(law);
    law_ = law;
  }
  void go_on(double dt) {
    if (former_.empty()) return;
    age_ += dt;
    bool any = false;
    for (std::size_t i = 0; i < rows_; ++i) {
      const double left = pace_[i] > 0.0 ? 1.0 - std::min(1.0, age_ * pace_[i]) : 0.0;
      for (const std::size_t k : former_) share(k)[i] = left * before_[k * rows_ + i];
      any = any || left != 0.0;
    }
    if (!any) former_.clear();
  }

  bool going() const { return !former_.empty(); }
  // Pass each law that holds beside its own, and the share of each row.
  template <class Visit>
  void beside(const Visit& visit) const {
    for (const std::size_t k : former_)
      if (k != law_) visit(laws_[k], &share_[k * rows_]);
  }

 private:
  void leave(std::size_t law) {
    former_.erase(std::remove(former_.begin(), former_.end(), law_), former_.end());
    for (std::size_t i = 0; i < rows_; ++i) {
      double others = 0.0;
      pace_[i] = std::max(laws_[law].pace[i], laws_[law_].pace[i]);
      for (const std::size_t k : former_) others += share(k)[i], pace_[i] = std::max(pace_[i], laws_[k].pace[i]);
      share(law_)[i] = 1.0 - others;
    }
    former_.push_back(law_);
    before_ = share_, age_ = 0.0;
  }
  double* share(std::size_t k) { return &share_[k * rows_]; }

  int start_;
  std::size_t rows_, law_ = 0;
  std::vector<RowsLaw> laws_;
  std::vector<std::size_t> former_;            // order of their end
  std::vector<double> pace_, before_, share_;  // before: share at the start of the change
  double age_ = 0.0;
};

}  // namespace hqp
