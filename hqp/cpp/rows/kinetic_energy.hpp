// Rows whose square is twice the kinetic energy: L^T of the joint-space inertia A = L L^T.
#pragma once

#include <cmath>
#include <stdexcept>
#include <vector>

#include "../dynamics/composite.hpp"
#include "rows.hpp"

namespace hqp {

class KineticEnergy final : public Operation {
 public:
  // inertias: inertias of all bodies. rotors: reflected inertia of each coordinate.
  KineticEnergy(Target out, const Tree& tree, const std::vector<BodyInertia>& inertias, std::vector<double> rotors)
      : out_(out),
        tree_(tree),
        n_(tree.size()),
        bodies_(tree, inertias),
        rotors_(std::move(rotors)),
        rate_(inertias.size()),
        A_(n_ * n_),
        dA_(out.drift ? n_ * n_ : 0),
        u_(n_) {
    if (static_cast<int>(rotors_.size()) != n_) throw std::invalid_argument("a rotor for every coordinate is needed");
  }

  void run(const double*, const double* v) override {
    bodies_.gather({}, false, false);
    std::fill(A_.begin(), A_.end(), 0.0);
    bodies_.write_inertia(rotors_.data(), A_.data());
    if (out_.drift) write_rate();
    factor();
    for (int i = 0; i < n_; ++i)
      for (int k = i; k < n_; ++k) out_.row(i)[k] = out_.weight * A(k, i);
    if (out_.drift) write_drift(v);
  }

 private:
  double& A(int i, int j) { return A_[i * n_ + j]; }
  double& dA(int i, int j) { return dA_[i * n_ + j]; }

  // dA/dt, from the rates of the inertias of all that each body carries.
  void write_rate() {
    const auto& bodies = tree_.bodies();
    for (std::size_t i = 1; i < bodies.size(); ++i) {
      const Body& body = bodies[i];
      const Mat3 R = load_rotation(body.rotation);
      const Vec3 p = load(body.position) + R * body.centre;
      const Motion& V = tree_.motion(static_cast<int>(i));
      rate_[i] = Inertia::rate(body.mass, p, turned(R, bodies_.own(static_cast<int>(i))), V.angular, V.at(p));
    }
    for (std::size_t i = bodies.size(); i-- > 1;)
      if (bodies[i].parent != 0) rate_[bodies[i].parent].add(rate_[i]);
    std::fill(dA_.begin(), dA_.end(), 0.0);
    for (int d = 0; d < n_; ++d) write_rate(d);
  }

  // Entries (c, d) and (d, c) for the coordinates c before d that carry d.
  void write_rate(int d) {
    const int body = tree_.owner(d);
    const Motion& S = bodies_.twist(d);
    const Form F = bodies_[body] * S, G = rate_[body] * S + bodies_[body] * cross(tree_.motion(body), S);
    for (int b = body; b > 0; b = tree_.bodies()[b].parent) {
      const Body& carrier = tree_.bodies()[b];
      for (int c = carrier.first; c < carrier.first + carrier.count && c <= d; ++c) {
        const Motion& T = bodies_.twist(c);
        dA(d, c) = dA(c, d) = value(G, T) + value(F, cross(tree_.motion(b), T));
      }
    }
  }

  // L in place of the lower half of A; a coordinate without inertia gets a row of zeros.
  void factor() {
    for (int i = 0; i < n_; ++i) {
      for (int j = 0; j <= i; ++j) {
        double sum = A(i, j);
        if (sum == 0.0 && j < i && zero(i, j)) continue;
        for (int k = 0; k < j; ++k) sum -= A(i, k) * A(j, k);
        if (j < i) A(i, j) = A(j, j) > 0.0 ? sum / A(j, j) : 0.0;
        else A(i, i) = sum > 0.0 ? std::sqrt(sum) : 0.0;
      }
    }
  }
  bool zero(int i, int j) {  // nothing before column j meets in rows i and j
    for (int k = 0; k < j; ++k)
      if (A(i, k) * A(j, k) != 0.0) return false;
    return true;
  }

  // dL^T/dt v = Phi^T L^T v with Phi the lower half of L^-1 dA/dt L^-T, its diagonal halved.
  void write_drift(const double* v) {
    for (int i = 0; i < n_; ++i) {
      u_[i] = 0.0;
      for (int k = i; k < n_; ++k) u_[i] += A(k, i) * v[k];
    }
    for (int pass = 0; pass < 2; ++pass) {  // L^-1 from the left, twice transposed
      for (int c = 0; c < n_; ++c)
        for (int i = 0; i < n_; ++i) {
          double sum = dA(i, c);
          for (int k = 0; k < i; ++k) sum -= A(i, k) * dA(k, c);
          dA(i, c) = A(i, i) > 0.0 ? sum / A(i, i) : 0.0;
        }
      for (int i = 0; i < n_; ++i)
        for (int j = 0; j < i; ++j) std::swap(dA(i, j), dA(j, i));
    }
    for (int j = 0; j < n_; ++j) {
      double sum = 0.5 * dA(j, j) * u_[j];
      for (int i = j + 1; i < n_; ++i) sum += dA(i, j) * u_[i];
      out_.drift[j] = sum;
    }
  }

  Target out_;
  const Tree& tree_;
  int n_;
  Composite bodies_;
  std::vector<double> rotors_;
  std::vector<Inertia> rate_;
  std::vector<double> A_, dA_, u_;
};

}  // namespace hqp
