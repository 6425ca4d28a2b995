// Python's objects as plans: objects of hqp/declare/plans.py, and NumPy arrays in place: a converted copy would never
// change.
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

#include "plan.hpp"

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

// Keeps the arrays behind its pointers alive.
class LivePlan : public hqp::PlanOf<LivePlan> {
 public:
  LivePlan(nb::object object, std::vector<nb::object>& kept) : object_(std::move(object)), kept_(&kept) {}

  using PlanOf::doubles;
  using PlanOf::flag;
  using PlanOf::integer;
  using PlanOf::ints;
  using PlanOf::number;
  using PlanOf::numbers;
  using PlanOf::parts;

  std::string name() const { return nb::cast<std::string>(nb::handle(object_.type()).attr("__name__")); }
  bool is_none() const { return object_.is_none(); }
  double number() const { return nb::cast<double>(object_); }
  int integer() const { return nb::cast<int>(object_); }
  bool flag() const { return nb::cast<bool>(object_); }
  Ints ints() const { return nb::cast<Ints>(object_); }
  Numbers numbers() const { return nb::cast<Numbers>(object_); }
  std::string text(const char* field) const { return nb::cast<std::string>(part(field).object_); }
  std::vector<std::string> texts(const char* field) const {
    return nb::cast<std::vector<std::string>>(part(field).object_);
  }
  bool has(const char* field) const {
    if (!PyDict_Check(object_.ptr())) return nb::hasattr(object_, field) && !part(field).is_none();
    const nb::object key = nb::steal(PyUnicode_FromString(field));
    PyObject* found = PyDict_GetItem(object_.ptr(), key.ptr());
    return found && found != Py_None;
  }
  const nb::object& object() const { return object_; }
  LivePlan part(const char* field) const {
    const bool named = PyDict_Check(object_.ptr());
    return {named ? nb::object(object_[field]) : nb::object(object_.attr(field)), *kept_};
  }
  std::vector<LivePlan> parts() const {
    std::vector<LivePlan> found;
    for (const nb::handle one : object_) found.emplace_back(nb::borrow(one), *kept_);
    return found;
  }
  std::size_t size() const { return array<const double>().size(); }
  double* doubles(std::size_t count) const { return const_cast<double*>(held<const double>(count)); }
  const std::int64_t* longs(std::size_t count) const { return held<const std::int64_t>(count); }
  std::int8_t* bytes(std::size_t count) const { return const_cast<std::int8_t*>(held<const std::int8_t>(count)); }
  std::int32_t* slots(int& rows) const {
    const auto array = nb::cast<Slots>(object_, false);
    rows = static_cast<int>(array.shape(0));
    return hold(array);
  }

 private:
  template <class T>
  nb::ndarray<T, nb::device::cpu> array() const {
    return nb::cast<nb::ndarray<T, nb::device::cpu>>(object_, false);
  }
  // Row by row or column by column, as it is.
  template <class T>
  T* held(std::size_t count) const {
    const auto found = array<T>();
    const auto dense = [&](bool last_first) {
      std::int64_t step = 1;
      for (std::size_t k = 0; k < found.ndim(); ++k) {
        const std::size_t i = last_first ? found.ndim() - 1 - k : k;
        if (found.shape(i) > 1 && found.stride(i) != step) return false;
        step *= static_cast<std::int64_t>(found.shape(i));
      }
      return true;
    };
    if (found.size() != count || !(dense(true) || dense(false)))
      throw nb::value_error("a live array has a wrong shape");
    return hold(found);
  }
  template <typename Array>
  auto hold(const Array& array) const -> decltype(array.data()) {
    kept_->push_back(nb::cast(array));
    return array.data();
  }

  nb::object object_;
  std::vector<nb::object>* kept_;
};

}  // namespace binding
