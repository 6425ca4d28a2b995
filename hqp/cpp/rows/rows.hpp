// Where the rows of an element go, and how one is written.
#pragma once

#include "observer.hpp"

namespace hqp {

struct Target {
  double* J;  // (m, nv) row-major
  double* error;
  double* drift;  // null where nobody asks for it
  const double* reference;
  double weight;
  int nv;
  double* row(int i) const { return J + static_cast<std::ptrdiff_t>(i) * nv; }
};

class Operation {
 public:
  virtual ~Operation() = default;
  virtual void run(const double* q, const double* v) = 0;
};

class Rows {  // of a frame as somebody sees it
 public:
  Rows(Target out, const Tree& tree, Frame frame, Observer observer)
      : out_(out), tree_(tree), frame_(std::move(frame)), observer_(std::move(observer)) {}

 protected:
  Vec3 origin() const { return load(frame_.position); }
  Mat3 rotation() const { return load_rotation(frame_.rotation); }
  const Motion& motion() const { return tree_.motion(frame_.body); }
  const Motion& body_drift() const { return tree_.drift(frame_.body); }
  Vec3 seen_drift(const Vec3& p) const {
    return observer_.point_drift(tree_, p, motion().at(p), tree_.point_drift(frame_.body, p));
  }

  void write_velocity(int i, const Vec3& u, const Vec3& p) { write(i, along(u, p), observer_.carried(u, p)); }
  void write_turning(int i, const Vec3& u) { write(i, about(u), observer_.turned(u)); }
  void subtract_carried(int i, const Form& carried) {
    double* J = out_.row(i);
    for (const int c : observer_.columns()) J[c] -= value(carried, c);
  }
  void clear_carried(int i) {
    double* J = out_.row(i);
    for (const int c : observer_.columns()) J[c] = 0.0;
  }

  Target out_;
  const Tree& tree_;
  Frame frame_;
  Observer observer_;

 private:
  double value(const Form& form, int column) const {
    const double* t = tree_.twist(column);
    return out_.weight * (dot(form.linear, load(t)) + dot(form.angular, load(t + 3)));
  }
  void write(int i, const Form& own, const Form& carried) {
    double* J = out_.row(i);
    clear_carried(i);
    for (const int c : frame_.columns) J[c] = value(own, c);
    subtract_carried(i, carried);
  }
};

}  // namespace hqp
