// What an operation is made of, read field by field: from an object of hqp/declare/plans.py, or from a file.
#pragma once

#include <array>
#include <cstddef>
#include <stdexcept>
#include <string>
#include <vector>

#include "../dynamics/inertia.hpp"
#include "barrier.hpp"
#include "directions.hpp"
#include "joints.hpp"
#include "relative_frame.hpp"

namespace hqp {

inline Vec3 vector(const std::vector<double>& a) {
  if (a.size() != 3) throw std::invalid_argument("a vector has three numbers");
  return load(a.data());
}

// Self reads: name() of the plan's class; is_none(), number(), integer(), flag(), ints(), numbers(), of itself;
// has(field), part(field) and parts(), what it holds; doubles(count), longs(count), bytes(count) and size(), live
// arrays.
template <class Self>
class PlanOf {
 public:
  double number(const char* field) const { return part(field).number(); }
  int integer(const char* field) const { return part(field).integer(); }
  bool flag(const char* field) const { return part(field).flag(); }
  std::vector<int> ints(const char* field) const { return part(field).ints(); }
  std::vector<double> numbers(const char* field) const { return part(field).numbers(); }
  Vec3 vec3(const char* field) const { return vector(numbers(field)); }
  std::vector<Self> parts(const char* field) const { return part(field).parts(); }
  double* doubles(const char* field, std::size_t count) const { return part(field).doubles(count); }
  double* maybe(const char* field, std::size_t count) const {  // null for none
    return self().has(field) ? part(field).doubles(count) : nullptr;
  }

  Frame frame() const { return {doubles("position", 3), doubles("rotation", 9), integer("body"), ints("columns")}; }
  Frame frame(const char* field) const { return part(field).frame(); }
  RelativeFrame relative() const {
    const Self other = part("relative_to");
    if (other.is_none()) return {};
    return {other.frame("frame"), other.flag("heading"), other.number("upright")};
  }
  Joints joints(const char* field) const { return part(field).joints(); }
  Joints joints() const {
    std::vector<bool> continuous;
    for (const Self& one : parts("continuous")) continuous.push_back(one.flag());
    return {ints("columns"), ints("positions"), std::move(continuous)};
  }
  Axis axis() const { return {vec3("axis"), vec3("first"), vec3("other")}; }
  Barrier barrier(double dt) const { return {number("rate"), number("recovery"), number("outset"), dt}; }
  std::vector<BodyInertia> inertias(const char* field) const {
    std::vector<BodyInertia> found;
    for (const Self& one : parts(field)) found.push_back(one.inertia());
    return found;
  }
  BodyInertia inertia() const {
    const std::vector<double> given = self().numbers();
    if (given.size() != 6) throw std::invalid_argument("an inertia has six numbers");
    BodyInertia found;
    std::copy(given.begin(), given.end(), found.begin());
    return found;
  }

 private:
  const Self& self() const { return static_cast<const Self&>(*this); }
  Self part(const char* field) const { return self().part(field); }
};

}  // namespace hqp
