// From rows on the acceleration to a solve on the torque, as a plan has it: from Python or from a file.
#pragma once

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <memory>
#include <set>
#include <vector>

#include "../common/isa.hpp"
#include "../common/solve_call.hpp"
#include "../rows/plan.hpp"
#include "elimination.hpp"
#include "holding.hpp"

namespace hqp {

// The elimination, with live A (nv, nv), bias (nv), J (m, nv) and gamma (m), then the rows of all levels, then a solve.
class TorqueParts final : public SolveCall {
 public:
  template <class Plan>
  explicit TorqueParts(const Plan& p) {
    const std::vector<int> parents = p.ints("parents"), actuated = p.places("actuated", parents.size());
    nv_ = parents.size(), n_ = actuated.size(), m_ = p.part("gamma").size();
    bool tree = std::set<int>(actuated.begin(), actuated.end()).size() == n_;
    for (std::size_t i = 0; tree && i < nv_; ++i) tree = parents[i] >= -1 && parents[i] < static_cast<int>(i);
    need(tree, "an elimination needs the joints of a tree");
    A_ = p.doubles("A", nv_ * nv_), bias_ = p.doubles("bias", nv_);
    J_ = p.doubles("J", m_ * nv_), gamma_ = p.doubles("gamma", m_);
    factor_ = p.doubles("factor", nv_ * nv_), map_ = p.doubles("map", nv_ * (n_ + 1)), phi_ = p.doubles("phi", n_ * n_);
    Q_ = p.doubles("Q", nv_ * m_), T_ = p.doubles("T", m_ * m_), top_ = p.doubles("top", m_ * (n_ + 1));
    tolerance_ = p.number("tolerance");
    out_.assign(m_, 0), held_.assign(m_ * nv_, 0.0), carried_.resize(nv_);
    const int nv = static_cast<int>(nv_), n = static_cast<int>(n_), m = static_cast<int>(m_);
    elimination_.reset(HQP_FOR_MACHINE(make_elimination, parents, motors(p, actuated), m, out_.data()));
    rows_.reset(HQP_FOR_MACHINE(make_torque_rows, map_, nv, n));
    for (const Plan& one : p.parts("products")) {
      const AccelerationRows requested = rows(one);
      rows_->product(one.doubles("J", std::size_t(requested.m) * nv_), requested);
    }
    for (const Plan& one : p.parts("picks")) {
      const AccelerationRows requested = rows(one);
      const std::vector<int> index = one.places("index", nv_);
      need(index.size() == std::size_t(requested.m), "a row picks one coordinate");
      rows_->pick(index, one.numbers("weight", index.size()), requested);
    }
    if (p.has("motion")) {
      const Plan motion = p.part("motion");
      rows_->motion(motion.numbers("scale", nv_), motion.number("rest"), motion.doubles("F", nv_ * n_),
                    motion.doubles("f", nv_));
    }
    if (p.has("forces")) {
      const Plan forces = p.part("forces");
      forces_.reset(HQP_FOR_MACHINE(make_force_rows, m, n));
      for (const Plan& one : forces.parts("ground"))
        forces_->ground(
            {one.doubles("rotation", 9), one.doubles("normal", 3), one.doubles("axes", 9), one.place("axis", 2) == 1});
      for (const Plan& one : forces.parts("frames"))
        forces_->turn(one.place("first", m_ < 3 ? 0 : m_ - 2), one.doubles("rotation", 9));
      for (const Plan& one : forces.parts("shared")) share(one);
      for (const Plan& one : forces.parts("rows")) {
        const AccelerationRows requested = rows(one);
        forces_->add(one.doubles("C", std::size_t(requested.m) * m_), requested);
      }
    }
    std::vector<int> others;
    for (int i = 0; i < nv; ++i)
      if (std::find(actuated.begin(), actuated.end(), i) == actuated.end()) others.push_back(i);
    if (p.has("axes")) axes_ = p.numbers("axes", nv_ * nv_), moved_.resize((m_ + 1) * nv_);
    if (m_ >= others.size()) holding_ = std::make_unique<Holding>(actuated, others, m);
  }
  TorqueParts(const TorqueParts&) = delete;

  // next: call of the solver, null if Python calls it.  limits: limiter of the bounds on the acceleration, or null.
  void before(SolveCall* next, Limiting* limits) { next_ = next, limits_ = limits; }

  Solved run(const double* v) override {
    const auto begin = std::chrono::steady_clock::now();
    if (eliminate() < 0) return {kInvalid};
    double square = 0.0;
    for (std::size_t i = 0; i < nv_; ++i) {
      const double c = map_[i * (n_ + 1) + n_];
      square += c * c;
    }
    if (!(square < INFINITY)) return {kInvalid};
    if (limits_) limits_->limit(v, *elimination_);
    write(v, nullptr);
    force(nullptr);
    const double before = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    Solved found = next_ ? next_->run(v) : Solved{kAskPython};
    found.before = before;
    return found;
  }
  void limit(double seconds) override {
    if (next_) next_->limit(seconds);
  }

  // Its parts: the rank of the constraints, -1 where A is not positive definite; rows, with the map's own c where c is
  // null; rows on forces, shift as in ForceRows.
  int eliminate() {
    std::copy(A_, A_ + nv_ * nv_, factor_);
    return elimination_->eliminate(factor_, bias_, J_, gamma_, tolerance_, map_, phi_, Q_, T_, top_);
  }
  void write(const double* v, const double* c) { rows_->run(v, c); }
  void force(const double* shift) {
    if (forces_) forces_->run(T_, top_, shift);
  }
  Reactions& reactions() { return *elimination_; }

  // Acceleration of a coordinate under these torques (n), by the map of the latest solve.
  double acceleration(std::size_t i, const double* tau) const {
    const double* row = map_ + i * (n_ + 1);
    double sum = row[n_];
    for (std::size_t j = 0; j < n_; ++j) sum += row[j] * tau[j];
    return sum;
  }

  double felt(std::size_t motor) const { return phi_[motor * (n_ + 1)]; }  // inverse of the inertia that it feels

  std::size_t coordinates() const { return nv_; }
  std::size_t motors() const { return n_; }
  std::vector<std::int8_t>& out() { return out_; }  // flags of the constraints, 1 for an absent one
  // The torque (n) that holds g (nv) on J (m, nv), or on the constraints that are there; false if there is none.
  bool hold(const double* J, const double* g, double* tau) {
    if (!holding_) return false;
    if (axes_.empty()) return holding_->torque(J, g, tau);
    for (std::size_t k = 0; k < m_; ++k) along(J + k * nv_, moved_.data() + k * nv_);
    double* weight = moved_.data() + m_ * nv_;
    along(g, weight);
    return holding_->torque(moved_.data(), weight, tau);
  }
  bool hold(const double* g, double* tau) {
    for (std::size_t k = 0; k < m_; ++k)
      for (std::size_t i = k * nv_; i < (k + 1) * nv_; ++i) held_[i] = out_[k] ? 0.0 : J_[i];
    return hold(held_.data(), g, tau);
  }

  // The multipliers lambda (m) of the constraints at a torque: T lambda = top (tau, 1), T upper triangular.
  void forces(const double* tau, std::vector<double>& lambda) const {
    lambda.resize(m_);
    for (std::size_t i = m_; i-- > 0;) {
      const double* row = top_ + i * (n_ + 1);
      double sum = row[n_];
      for (std::size_t j = 0; j < n_; ++j) sum += row[j] * tau[j];
      for (std::size_t k = i + 1; k < m_; ++k) sum -= T_[i * m_ + k] * lambda[k];
      lambda[i] = sum / T_[i * m_ + i];
    }
  }

  // The torques (n) that hold g (nv) and the momentum A v (nv), from A (its upper triangle, column-major) and J; false
  // if there are none.
  bool at_rest(const double* g, const double* v, double* tau, double* momentum) {
    if (!hold(g, tau) || eliminate() < 0) return false;
    for (std::size_t i = 0; i < nv_; ++i) {
      carried_[i] = 0.0;
      for (std::size_t j = 0; j < nv_; ++j) carried_[i] += A_[std::max(i, j) * nv_ + std::min(i, j)] * v[j];
    }
    return hold(carried_.data(), momentum);
  }

 private:
  template <class Plan>
  Motors motors(const Plan& p, const std::vector<int>& own) const {
    const std::vector<int> motors = p.places("motors", n_), joints = p.places("joints", nv_);
    const std::vector<double> factors = p.numbers("factors", motors.size());
    need(joints.size() == motors.size(), "an entry of the actuation has a motor and a joint");
    Motors found{own, {}};
    for (std::size_t k = 0; k < motors.size(); ++k) found.entries.push_back({motors[k], joints[k], factors[k]});
    return found;
  }
  // row (nv) of J or g, on the coordinates of the motors: row T.
  void along(const double* row, double* moved) const {
    std::fill(moved, moved + nv_, 0.0);
    for (std::size_t i = 0; i < nv_; ++i)
      for (std::size_t j = 0; j < nv_; ++j) moved[j] += row[i] * axes_[i * nv_ + j];
  }
  template <class Plan>
  AccelerationRows rows(const Plan& p) const {
    const std::size_t m = p.part("lower").size();
    return {static_cast<int>(m),          p.doubles("A", m * n_), p.doubles("demand_lower", m),
            p.doubles("demand_upper", m), p.doubles("lower", m),  p.doubles("upper", m)};
  }
  template <class Plan>
  void share(const Plan& p) {
    const std::vector<int> first = p.places("first", m_ < 6 ? 0 : m_ - 5);
    const std::vector<double> middles = p.numbers("middles", 4), factors = p.numbers("factors", 2);
    need(first.size() == 2, "two contacts share");
    forces_->share({p.doubles("C", 6 * m_),
                    {first[0], first[1]},
                    {p.doubles("one", 9), p.doubles("other", 9)},
                    {p.doubles("one_sole", 9), p.doubles("other_sole", 9)},
                    {{middles[0], middles[1]}, {middles[2], middles[3]}},
                    {factors[0], factors[1]},
                    p.number("arm"),
                    p.doubles("share", 1)});
  }

  std::size_t nv_, n_, m_;
  const double *A_, *bias_, *J_, *gamma_;
  double *factor_, *map_, *phi_, *Q_, *T_, *top_;  // factor (nv, nv): a copy of A
  double tolerance_;
  std::vector<std::int8_t> out_;
  std::vector<double> held_, carried_;  // J of the constraints that are there; A v
  std::vector<double> axes_, moved_;    // T (nv, nv), empty without tendons; J T and g T
  std::unique_ptr<Elimination> elimination_;
  std::unique_ptr<TorqueRows> rows_;
  std::unique_ptr<ForceRows> forces_;
  std::unique_ptr<Holding> holding_;
  SolveCall* next_ = nullptr;
  Limiting* limits_ = nullptr;
};

}  // namespace hqp
