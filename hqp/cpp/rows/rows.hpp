// Destination of an element's rows, and its row functions.
#pragma once

#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "../common/carry_over.hpp"
#include "relative_frame.hpp"

namespace hqp {

struct Target {
  double* J;  // (m, nv) row-major, null where the rows are a selection
  double* error;
  double* drift;  // null at velocity level
  double *lower, *upper;
  const double* reference;
  const double* normal;  // (3,) normal of the ground, null if the rows have none
  double weight;
  int nv;
  const double *rate, *feedforward;  // velocity and acceleration of the reference, null where no bounds move with it
  std::size_t rows, given;           // numbers of error, of reference
  double* row(int i) const { return J + static_cast<std::ptrdiff_t>(i) * nv; }
};

// Name of a row in the latest tick, null if it never changes, and its distance [m], NaN for none.
struct RowName {
  const char* name = nullptr;
  double distance = std::numeric_limits<double>::quiet_NaN();
};

class Operation {
 public:
  virtual ~Operation() = default;
  virtual void run(const double* q, const double* v) = 0;
  // Take the measured velocity ahead of run(), whose v may be the one that was sent last.
  virtual void measure(const double*) {}
  // Write the hold value of the element, in the form of its reference, for a reference of zeros; false if it holds the
  // declared value.
  virtual bool hold(const double*, const double*, double*) { return false; }
  // Distance beyond its limit at which each row comes to rest at best, 0 inside; for rows that limit a joint each.
  virtual void overrun(const double*, const double*, std::vector<double>&) {}
  // Way of a row beyond its position limits low and high, 0 inside; for rows that limit a joint each.
  virtual double outside(int, const double*, double&, double&) const { return 0.0; }
  // The rate at which bounds near the speed that they stand around, infinite for none.
  virtual double approach() const { return INFINITY; }
  // Recompute these bounds as demands: around a speed, beyond a deceleration, (nv) each.
  virtual void around(const double*, const double*) {}
  virtual RowName row_name(int) const { return {}; }
  // Switch a contact of that name on or off as support, from now on.
  virtual void stand(const std::string&, bool) {}
  // Forget earlier states: the next one is the first.
  virtual void begin() {}
  // Save or restore the state between ticks.
  virtual void keep(CarryOver&) {}
};

// Base of rows whose error is their value less the reference.
template <class Own>
bool hold_value(Own& own, const Target& out, int rows, const double* q, const double* v, double* value) {
  own.run(q, v);
  for (int i = 0; i < rows; ++i) value[i] = out.error[i] + out.reference[i];
  return true;
}

class Rows {  // rows of a frame, in the world or relative to another
 public:
  Rows(Target out, const Tree& tree, Frame frame, RelativeFrame relative)
      : out_(out), tree_(tree), frame_(std::move(frame)), relative_(std::move(relative)) {}

 protected:
  Vec3 origin() const { return load(frame_.position); }
  Mat3 rotation() const { return load_rotation(frame_.rotation); }
  const Motion& motion() const { return tree_.motion(frame_.body); }
  const Motion& body_drift() const { return tree_.drift(frame_.body); }
  Vec3 relative_drift(const Vec3& p) const {
    return relative_.point_drift(tree_, p, motion().at(p), tree_.point_drift(frame_.body, p));
  }

  void write_velocity(int i, const Vec3& u, const Vec3& p) { write(i, along(u, p), relative_.carried(u, p)); }
  void write_turning(int i, const Vec3& u) { write(i, about(u), relative_.turned(u)); }
  void write_form(int i, const Form& own) {  // row of a frame in the world
    double* J = out_.row(i);
    for (const int c : frame_.columns) J[c] = value(own, c);
  }
  void write_pair(int i, const Form& own, const Form& other) { write(i, own, other); }
  void subtract_carried(int i, const Form& carried) {
    double* J = out_.row(i);
    for (const int c : relative_.columns()) J[c] -= value(carried, c);
  }
  void clear_carried(int i) {
    double* J = out_.row(i);
    for (const int c : relative_.columns()) J[c] = 0.0;
  }

  Target out_;
  const Tree& tree_;
  Frame frame_;
  RelativeFrame relative_;

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
