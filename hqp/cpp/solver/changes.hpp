// Changes of a working set since the tableau's factorisation, while few and known.
#pragma once

#include <cstdint>

namespace hqp {
inline namespace HQP_ISA {

constexpr int kChanges = 24;  // most changes between factorisations

struct Changes {
  bool known = false;  // nothing else changed
  int joined = 0, left = 0;
  int front = -1;      // level that caused a row to leave, -1 without leaving rows
  int join[kChanges];  // row of the table, or rows + variable
  std::int8_t side[kChanges];
  int leave[kChanges];  // variables

  void start(int front_level = -1) {
    joined = left = 0;
    front = front_level;
    known = true;
  }
  void forget() { known = false; }

  void note_join(int what, std::int8_t at) {
    if (joined == kChanges) {
      known = false;
      return;
    }
    join[joined] = what;
    side[joined++] = at;
  }

  void note_leave(int variable) {
    if (left == kChanges) {
      known = false;
      return;
    }
    leave[left++] = variable;
  }
};

}  // namespace HQP_ISA
}  // namespace hqp
