// References of Python: their numbers, read without a copy, and put where rows read them.
#pragma once

#include <cstring>
#include <string>
#include <vector>

#include <nanobind/nanobind.h>

#include "references.hpp"

namespace hqp {

namespace nb = nanobind;

// Names of the fields of hqp.declare.reference.Reference.
struct ReferenceFields {
  nb::str name{"name"}, value{"value"}, velocity{"velocity"}, acceleration{"acceleration"}, normal{"normal"},
      gravity_normal{"gravity_normal"};
};

// The numbers of an array of doubles. data(): without a copy, null where the object is no such array, or not
// contiguous.
class Doubles {
 public:
  // known: to hold doubles, as the arrays of a State do; NumPy builds the format text at each request.
  explicit Doubles(nb::handle array, bool known = false) : known_(known) {
    held_ = PyObject_GetBuffer(array.ptr(), &view_, known ? PyBUF_ND : PyBUF_ND | PyBUF_FORMAT) == 0;
    if (!held_) PyErr_Clear();
  }
  ~Doubles() {
    if (held_) PyBuffer_Release(&view_);
  }
  Doubles(const Doubles&) = delete;

  const double* data() const {
    const bool doubles = held_ && (known_ || (view_.format && !std::strcmp(view_.format, "d")));
    return doubles ? static_cast<const double*>(view_.buf) : nullptr;
  }
  // Copy in row-major order, for any strides; false where the object is no such array.
  static bool copy(nb::handle array, double* to, const int* shape, int dimensions) {
    Doubles numbers(array, PyBUF_STRIDES | PyBUF_FORMAT);  // Python 3.10 takes no const Py_buffer
    return numbers.data() && numbers.has(shape, dimensions) &&
           PyBuffer_ToContiguous(to, &numbers.view_, numbers.view_.len, 'C') == 0;
  }
  bool has(const int* shape, int dimensions) const {
    if (!held_ || view_.ndim != dimensions) return false;
    for (int i = 0; i < dimensions; ++i)
      if (view_.shape[i] != shape[i]) return false;
    return true;
  }

 private:
  Doubles(nb::handle array, int flags) : known_(false) {
    held_ = PyObject_GetBuffer(array.ptr(), &view_, flags) == 0;
    if (!held_) PyErr_Clear();
  }

  Py_buffer view_;
  bool known_, held_;
};

// Buffers of a stack's references.
class Loop {
 public:
  explicit Loop(nb::object reference) : reference_(std::move(reference)) {}

  void add(const std::string& name, Slot slot) {
    index_[nb::str(name.c_str())] = nb::int_(slots_.size());
    slots_.push_back(std::move(slot));
  }
  // Write the given references, and hold values for all others; return false for an irregular reference.
  bool take(const nb::tuple& references, bool fresh) {
    settle(slots_, fresh);
    for (const nb::handle reference : references)
      if (!take(reference)) return false;
    return true;
  }

 private:
  bool take(nb::handle reference) {
    if (reinterpret_cast<PyObject*>(Py_TYPE(reference.ptr())) != reference_.ptr()) return false;
    const nb::object given = nb::steal(PyObject_GenericGetDict(reference.ptr(), nullptr));  // other fields are None
    if (!given.is_valid()) nb::raise_python_error();
    const nb::handle name = field(given, fields_.name);
    PyObject* found = name.is_valid() ? PyDict_GetItem(index_.ptr(), name.ptr()) : nullptr;
    if (!found) return false;
    Slot& slot = slots_[PyLong_AsSize_t(found)];
    slot.moved = true;
    const int three[] = {3};
    const int dimensions = static_cast<int>(slot.shape.size());
    return (slot.elsewhere || copy(field(given, fields_.value), slot.target, slot.shape.data(), dimensions)) &&
           copy(field(given, fields_.velocity), slot.rate, &slot.rows, 1) &&
           copy(field(given, fields_.acceleration), slot.feedforward, &slot.rows, 1) &&
           copy(field(given, fields_.normal), slot.normal, three, 1) && slot.is_finite() &&
           !field(given, fields_.gravity_normal).is_valid();
  }

  // Null for None, too.
  static nb::handle field(nb::handle given, const nb::str& name) {
    PyObject* found = PyDict_GetItem(given.ptr(), name.ptr());
    return found == Py_None ? nullptr : found;
  }

  // Numbers of that shape; null keeps the present numbers.
  static bool copy(nb::handle array, double* to, const int* shape, int dimensions) {
    return !array.is_valid() || (to && Doubles::copy(array, to, shape, dimensions));
  }

  nb::object reference_;
  ReferenceFields fields_;
  nb::dict index_;
  std::vector<Slot> slots_;
};

}  // namespace hqp
