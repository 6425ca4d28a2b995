// The record of a tick: a bytearray that hqp/loop/tick.py reads.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include <nanobind/nanobind.h>

#include "guarded.hpp"

namespace binding {

namespace nb = nanobind;

// Numbers: command, x, the solver's x, slacks, begin, seconds for rows and for the solver, iterations,
// factorisations, the solver's status, q, v and, at velocity level, the next q; then points of stages, marks, and a
// byte: 1 if the solver answered + 2 if it has stages.  next: room for the next q, empty at other levels.
inline nb::object record(const hqp::Guarded& session, std::vector<double>& next) {
  const hqp::Tick& tick = session.tick();
  const hqp::Line& line = session.line();
  const hqp::Answered* answer = session.answered();
  const std::size_t n = std::size_t(line.size()), rows = line.rows(), points = answer ? answer->point_count : 0;
  const std::size_t numbers = tick.command().size() + 2 * n + rows + 6 + session.latest().q.size() +
                              session.latest().v.size() + next.size() + points;
  const nb::object made =
      nb::steal(PyByteArray_FromStringAndSize(nullptr, static_cast<Py_ssize_t>(sizeof(double) * numbers + rows + 1)));
  if (!made.is_valid()) nb::raise_python_error();
  double* out = reinterpret_cast<double*>(PyByteArray_AsString(made.ptr()));
  out = std::copy(tick.command().begin(), tick.command().end(), out);
  out = std::copy(tick.x().begin(), tick.x().end(), out);
  if (answer) {
    out = std::copy(answer->x, answer->x + n, out);
    out = std::copy(answer->slack, answer->slack + rows, out);
  } else {
    std::fill(out, out + n + rows, 0.0);
    out += n + rows;
  }
  for (const double number : {session.timing().begun(), session.timing().filling(), session.timing().solving(),
                              answer ? double(answer->iterations) : 0.0, answer ? double(answer->factorisations) : 0.0,
                              answer ? double(static_cast<int>(answer->status)) : 0.0})
    *out++ = number;
  out = std::copy(session.latest().q.begin(), session.latest().q.end(), out);
  out = std::copy(session.latest().v.begin(), session.latest().v.end(), out);
  if (!next.empty()) {
    line.kinematics()->integrate(session.latest().q.data(), tick.x().data(), line.dt(), next.data());
    out = std::copy(next.begin(), next.end(), out);
  }
  if (points) out = std::copy(answer->points, answer->points + points, out);
  std::int8_t* marks = reinterpret_cast<std::int8_t*>(out);
  if (answer) std::copy(answer->marks, answer->marks + rows, marks);
  else std::fill(marks, marks + rows, std::int8_t(0));
  marks[rows] = static_cast<std::int8_t>((answer ? 1 : 0) + (points ? 2 : 0));
  return made;
}

}  // namespace binding
