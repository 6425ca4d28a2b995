// A working set: active rows with their sides, and variables held at a bound.
#pragma once

#include "changes.hpp"
#include "table.hpp"

namespace hqp {
inline namespace HQP_ISA {

// A working row or a held variable that holds the optimum back.
struct WrongSign {
  int level;  // block that requires it
  int index;  // row of the table, or variable
  bool variable;
  double size;  // length of the force in x
};

struct WorkingSet {
  std::int8_t* W = nullptr;  // (rows,) side at which a row works, kFree if it does not
  std::int8_t* F = nullptr;  // (n,) the same for the bounds on variables
  Changes changes;           // since the tableau was made

  void layout(Arena& arena, int n, int rows) {
    arena.place(W, rows);
    arena.place(F, n);
  }

  // Start with the valid part of the last problem's set, else with the equalities only.
  void start(const Table& table, bool warm) {
    changes.forget();
    for (int r = 0; r < table.rows; ++r) {
      if (table.kind[r] == kEquality) W[r] = kEquality;
      else if (table.kind[r] == kFree || !warm || W[r] == kEquality) W[r] = kFree;
      else if ((W[r] == kUpper && table.upper[r] == kInfinity) || (W[r] == kLower && table.lower[r] == -kInfinity))
        W[r] = kFree;
    }
    for (int i = 0; i < table.n; ++i) {
      if (table.fixed[i]) F[i] = kUpper;
      else if (!warm || (F[i] > 0 && table.hi[i] == kInfinity) || (F[i] < 0 && table.lo[i] == -kInfinity)) F[i] = kFree;
    }
  }

  // A set as it was; differences from the tableau's set are not followed.
  void restore(const Table& table, const WorkingSet& old) {
    for (int r = 0; r < table.rows; ++r) W[r] = old.W[r];
    for (int i = 0; i < table.n; ++i) F[i] = old.F[i];
    changes.forget();
  }

  // Rows violated at values v (rows,) work at their side, rows well inside do not, rows at a bound stay as they are.
  void sort(const Table& table, const double* v, double size) {
    for (int q = 0; q < table.inequalities; ++q) {
      const int r = table.unequal[q];
      const double above = table.slackness(r, table.upper[r], size), below = table.slackness(r, table.lower[r], size);
      const std::int8_t old = W[r];
      if (v[r] > table.upper[r] + above) W[r] = kUpper;
      else if (v[r] < table.lower[r] - below) W[r] = kLower;
      else if (W[r] == kUpper && v[r] < table.upper[r] - above) W[r] = kFree;
      else if (W[r] == kLower && v[r] > table.lower[r] + below) W[r] = kFree;
      if (W[r] != old) changes.forget();
    }
  }

  void join(int r, std::int8_t side) {
    W[r] = side;
    changes.note_join(r, side);
  }

  void hold(const Table& table, int variable, std::int8_t side) {
    F[variable] = side;
    changes.note_join(table.rows + variable, side);
  }

  void release(const Table& table, const WrongSign& wrong) {
    if (wrong.variable) {
      F[wrong.index] = kFree;
      changes.note_leave(wrong.index);
    } else {
      W[wrong.index] = kFree;
      if (wrong.index < table.block[wrong.level].begin) changes.forget();  // one of its own level is not in front of it
    }
  }

  std::uint64_t hash(const Table& table) const {
    return mixed(F, table.n, mixed(W, table.rows, 1469598103934665603ull));
  }

 private:
  static std::uint64_t mixed(const std::int8_t* marks, int count, std::uint64_t hash) {
    for (int i = 0; i < count; i += 8) {
      std::uint64_t word = 0;
      std::memcpy(&word, marks + i, static_cast<std::size_t>(count - i < 8 ? count - i : 8));
      hash = (hash ^ word) * 0x9e3779b97f4a7c15ull;
      hash ^= hash >> 32;
    }
    return hash;
  }
};

}  // namespace HQP_ISA
}  // namespace hqp
