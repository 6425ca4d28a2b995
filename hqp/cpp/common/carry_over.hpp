// What of a solver, or of rows, goes over from one tick to the next: written into bytes, or read back in the same
// order.
#pragma once

#include <cstddef>
#include <cstring>
#include <vector>

namespace hqp {

class CarryOver {
 public:
  static CarryOver to(std::vector<char>& bytes) { return {bytes, true}; }
  static CarryOver from(std::vector<char>& bytes) { return {bytes, false}; }

  template <class T>
  void take(T* values, std::size_t count) {
    const std::size_t size = count * sizeof(T);
    if (size == 0) return;
    if (writes_) {
      if (bytes_.size() < at_ + size) bytes_.resize(at_ + size);
      std::memcpy(bytes_.data() + at_, values, size);
    } else {
      std::memcpy(values, bytes_.data() + at_, size);
    }
    at_ += size;
  }
  template <class T>
  void take(T& value) {
    take(&value, 1);
  }
  template <class T>
  void list(std::vector<T>& values) {  // of a length that changes
    std::size_t size = values.size();
    take(size);
    if (!writes_) values.resize(size);
    take(values.data(), size);
  }
  bool writes() const { return writes_; }

 private:
  CarryOver(std::vector<char>& bytes, bool writes) : bytes_(bytes), writes_(writes) {}

  std::vector<char>& bytes_;
  bool writes_;
  std::size_t at_ = 0;
};

}  // namespace hqp
