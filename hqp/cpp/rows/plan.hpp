// Objects of hqp/plans.py as the row operations take them.
#pragma once

#include <cstdint>
#include <string>
#include <tuple>
#include <vector>

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include "barrier.hpp"
#include "directions.hpp"
#include "joints.hpp"
#include "relative_frame.hpp"

namespace binding {

namespace nb = nanobind;

using Vector = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Written = nb::ndarray<double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Block = nb::ndarray<double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Columns = nb::ndarray<const double, nb::ndim<2>, nb::f_contig, nb::device::cpu>;
using WrittenColumns = nb::ndarray<double, nb::ndim<2>, nb::f_contig, nb::device::cpu>;
using Picks = nb::ndarray<const std::intptr_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Marks = nb::ndarray<const std::int8_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Kinds = nb::ndarray<const std::int8_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Slots = nb::ndarray<std::int32_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Ints = std::vector<int>;
using Numbers = std::vector<double>;

using Placement = std::tuple<Vector, Columns>;                                      // position, rotation
using Bodies = std::vector<std::tuple<int, int, int, double, Numbers, Placement>>;  // hqp.robot.Body

inline hqp::Vec3 vector(const Numbers& a) {
  if (a.size() != 3) throw nb::value_error("a vector has three numbers");
  return hqp::load(a.data());
}

// An object of hqp/plans.py, its fields by name. Live arrays are taken as they are: a converted copy would never
// change.
class Plan {
 public:
  Plan(nb::handle object, std::vector<nb::object>& kept) : object_(object), kept_(kept) {}

  std::string name() const { return nb::cast<std::string>(nb::handle(object_.type()).attr("__name__")); }
  double number(const char* field) const { return nb::cast<double>(object_.attr(field)); }
  Ints ints(const char* field) const { return nb::cast<Ints>(object_.attr(field)); }
  Numbers numbers(const char* field) const { return nb::cast<Numbers>(object_.attr(field)); }
  hqp::Vec3 vec3(const char* field) const { return vector(numbers(field)); }

  hqp::Frame frame() const {
    return {live<Vector>("position"), live<Columns>("rotation"), nb::cast<int>(object_.attr("body")), ints("columns")};
  }
  hqp::Frame frame_of(const char* field) const { return part(field).frame(); }
  hqp::RelativeFrame relative() const {
    if (object_.attr("relative_to").is_none()) return {};
    const Plan other = part("relative_to");
    return {other.frame_of("frame"), nb::cast<bool>(other.object_.attr("heading")), other.number("upright")};
  }
  hqp::Joints joints() const {
    return {ints("columns"), ints("positions"), nb::cast<std::vector<bool>>(object_.attr("continuous"))};
  }
  template <typename T>
  std::vector<T> list(const char* field) const {
    return nb::cast<std::vector<T>>(object_.attr(field));
  }
  template <typename Array>
  Array array(const char* field) const {
    const auto found = nb::cast<Array>(object_.attr(field), false);
    kept_.push_back(nb::cast(found));
    return found;
  }
  bool flag(const char* field) const { return nb::cast<bool>(object_.attr(field)); }
  hqp::Axis axis() const { return {vec3("axis"), vec3("first"), vec3("other")}; }
  hqp::Barrier barrier(double dt) const { return {number("rate"), number("recovery"), number("outset"), dt}; }
  Plan part_of(const nb::object& object) const {
    kept_.push_back(object);
    return {kept_.back(), kept_};
  }
  Plan part(const char* field) const {
    kept_.push_back(nb::object(object_.attr(field)));
    return {kept_.back(), kept_};
  }

 private:
  template <typename Array>
  const double* live(const char* field) const {
    const auto array = nb::cast<Array>(object_.attr(field), false);
    kept_.push_back(nb::cast(array));
    return array.data();
  }

  nb::handle object_;
  std::vector<nb::object>& kept_;
};

}  // namespace binding
