// One block of memory, taken at construction and never again.
#pragma once

#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <new>

namespace hqp {

// Hands out pieces of one block; run it once with no block to learn the size, then again to place the pieces.
class Arena {
 public:
  Arena() = default;
  ~Arena() {
    std::free(memory_);
#ifdef __SANITIZE_ADDRESS__
    for (int i = 0; i < pieces_; ++i) std::free(piece_[i]);
#endif
  }
  Arena(const Arena&) = delete;
  Arena& operator=(const Arena&) = delete;

  template <class T>
  void place(T*& piece, std::size_t count) {
    const std::size_t bytes = (count * sizeof(T) + 63) / 64 * 64;
#ifdef __SANITIZE_ADDRESS__  // pieces apart, so that no step from one into the next goes unseen
    if (block_) {
      void* apart = nullptr;
      if (pieces_ == kPieces || posix_memalign(&apart, 64, count * sizeof(T) + 1)) throw std::bad_alloc();
      std::memset(apart, 0, count * sizeof(T) + 1);
      piece = static_cast<T*>(piece_[pieces_++] = apart);
    }
#else
    if (block_) piece = reinterpret_cast<T*>(block_ + used_);
#endif
    used_ += bytes;
  }

  // Take the memory that the dry run counted, zeroed (large blocks by the system, when first touched), and start
  // placing.
  void take() {
    memory_ = std::calloc(used_ + 128, 1);
    if (!memory_) throw std::bad_alloc();
    const std::uintptr_t start = reinterpret_cast<std::uintptr_t>(memory_);
    block_ = reinterpret_cast<char*>((start + 63) / 64 * 64);
    used_ = 0;
  }

 private:
  void* memory_ = nullptr;
  char* block_ = nullptr;
  std::size_t used_ = 0;
#ifdef __SANITIZE_ADDRESS__
  static constexpr int kPieces = 4096;
  void* piece_[kPieces];
  int pieces_ = 0;
#endif
};

}  // namespace hqp
