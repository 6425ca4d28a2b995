// Views of a Hierarchy's arrays, read from its attributes without a conversion.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>
#include <vector>

#include <nanobind/nanobind.h>

#include "../priced/stages.hpp"
#include "problem.hpp"

namespace hqp {

namespace nb = nanobind;

class Reader {
 public:
  // Fills one view a level; false where the shape is another or an array would have to be converted. The views are
  // valid while the hierarchy lives and keeps its arrays, and so are its prices, one a level, null for none.
  bool read(const nb::object& hierarchy, int n, const std::vector<int>& rows, bool metric, Level* levels,
            Problem& problem, const double*& prices) {
    nb::object all, count, first, second;
    if (!get(hierarchy, key_levels_, all) || !PyTuple_Check(all.ptr())) return false;
    if (PyTuple_Size(all.ptr()) != static_cast<Py_ssize_t>(rows.size())) return false;
    if (!get(hierarchy, key_n_, count) || PyLong_AsLong(count.ptr()) != n) return cleared();
    for (std::size_t k = 0; k < rows.size(); ++k)
      if (!level(PyTuple_GetItem(all.ptr(), static_cast<Py_ssize_t>(k)), n, rows[k], levels[k])) return false;
    if (!get(hierarchy, key_metric_, first) || !get(hierarchy, key_origin_, second)) return false;
    if (first.is_none() == metric) return false;
    problem.metric = problem.origin = nullptr;
    if (!first.is_none() && !(problem.metric = numbers(first.ptr(), n, n))) return false;
    if (!second.is_none() && !(problem.origin = numbers(second.ptr(), n, -1))) return false;
    if (!get(hierarchy, key_constraints_, count)) return false;
    problem.constraints = static_cast<int>(PyLong_AsLong(count.ptr()));
    if (PyErr_Occurred()) return cleared();
    prices = nullptr;
    if (!get(hierarchy, key_prices_, first)) first = nb::none();  // plain rows have none
    if (!first.is_none() && !(prices = numbers(first.ptr(), static_cast<int>(rows.size()), -1))) return false;
    problem.levels = levels;
    problem.count = static_cast<int>(rows.size());
    return true;
  }

  // Read its law, whose prices have been read; false where they are no prices, or of levels that have none.
  bool read_law(const nb::object& hierarchy, int n, const std::vector<char>& priced, const double* prices, Law& law) {
    nb::object given, part;
    const int levels = static_cast<int>(priced.size());
    law = Law();
    law.prices = prices;
    if (!prices) return true;
    for (int k = 0; k < levels; ++k)
      if (!(prices[k] >= 0.0 && prices[k] < INFINITY) || (prices[k] > 0.0 && !priced[k])) return false;
    if (!get(hierarchy, key_eta_, given)) return false;
    law.eta = PyFloat_AsDouble(given.ptr());
    if (PyErr_Occurred()) return cleared();
    if (!get(hierarchy, key_turning_, given)) return false;
    if (!given.is_none() && !(law.turning = numbers(given.ptr(), levels, -1))) return false;
    if (!get(hierarchy, key_motion_, given)) return false;
    if (given.is_none()) return true;
    if (!get(given, key_F_, part)) return false;
    if (!(law.F = numbers(part.ptr(), n, -1))) {
      law.r = static_cast<int>(PyObject_Length(part.ptr()));
      if (law.r < 1 || !(law.F = numbers(part.ptr(), law.r, n))) return cleared();
    }
    if (!get(given, key_f_, part)) return false;
    return part.is_none() || (law.f = numbers(part.ptr(), law.r ? law.r : n, -1));
  }

 private:
  nb::str key_levels_{"levels"}, key_n_{"n"}, key_metric_{"metric"}, key_origin_{"origin"},
      key_constraints_{"constraints"}, key_A_{"A"}, key_lower_{"lower"}, key_upper_{"upper"}, key_index_{"index"},
      key_scale_{"scale"}, key_prices_{"prices"}, key_eta_{"eta"}, key_turning_{"turning"}, key_motion_{"motion"},
      key_F_{"F"}, key_f_{"f"};

  static bool cleared() {
    PyErr_Clear();
    return false;
  }

  static bool get(nb::handle of, const nb::str& name, nb::object& value) {
    value = nb::steal(PyObject_GetAttr(of.ptr(), name.ptr()));
    return value.is_valid() || cleared();
  }

  bool level(nb::handle rows, int n, int m, Level& view) {
    nb::object A, lower, upper;
    if (!get(rows, key_A_, A) || !get(rows, key_lower_, lower) || !get(rows, key_upper_, upper)) return false;
    view.m = m;
    view.A = nullptr;
    view.index = nullptr;
    view.scale = nullptr;
    if (PyObject_CheckBuffer(A.ptr())) {
      if (!(view.A = numbers(A.ptr(), m, n))) return false;
    } else {
      nb::object index, scale;
      if (!get(A, key_index_, index) || !get(A, key_scale_, scale)) return false;
      view.index = static_cast<const std::int64_t*>(array(index.ptr(), "lq", m, -1));
      view.scale = numbers(scale.ptr(), m, -1);
      if (!view.index || !view.scale) return false;
    }
    return (view.lower = numbers(lower.ptr(), m, -1)) && (view.upper = numbers(upper.ptr(), m, -1));
  }

  static const double* numbers(PyObject* a, int first, int second) {
    return static_cast<const double*>(array(a, "d", first, second));
  }

  // The numbers of a contiguous, aligned array of that shape (one axis if second < 0) and of one of the types, else
  // null.
  static const void* array(PyObject* a, const char* types, int first, int second) {
    static const double nothing = 0.0;
    Py_buffer view;
    if (PyObject_GetBuffer(a, &view, PyBUF_ND | PyBUF_FORMAT) != 0) {
      PyErr_Clear();
      return nullptr;
    }
    const bool aligned = reinterpret_cast<std::uintptr_t>(view.buf) % alignof(double) == 0;
    const bool fits = aligned && view.itemsize == 8 && view.format && std::strlen(view.format) == 1 &&
                      std::strchr(types, view.format[0]) && view.ndim == (second < 0 ? 1 : 2) &&
                      view.shape[0] == first && (second < 0 || view.shape[1] == second);
    const void* data = !fits ? nullptr : view.buf ? view.buf : &nothing;
    PyBuffer_Release(&view);
    return data;
  }
};

}  // namespace hqp
