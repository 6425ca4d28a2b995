// Many worlds of one plan over a few sessions, one per thread: a world is the state between two ticks.
#pragma once

#include <atomic>
#include <memory>
#include <string>
#include <system_error>
#include <thread>
#include <tuple>
#include <vector>

#include "stacks.hpp"

namespace hqp {

using NoteRecord = std::tuple<std::string, int, std::string>;  // element, status, text

// Texts of a tick's notes, whose names live as long as its session.
inline std::vector<NoteRecord> records(const Tick& tick) {
  std::vector<NoteRecord> found;
  for (const Note& note : tick.notes()) found.emplace_back(note.element, static_cast<int>(note.status), note.text());
  return found;
}

// Targets of one element in all worlds: (count, size), one behind the other.
struct BatchTarget {
  std::size_t element;
  int what;  // field of Reference
  const double* values;
  std::size_t size;
};

class Batch {
 public:
  Batch(std::shared_ptr<const Plan> plan, std::size_t count, std::size_t threads) : worlds_(count) {
    if (threads == 0) threads = std::max(1u, std::thread::hardware_concurrency());
    threads = std::max<std::size_t>(1, std::min(threads, count));
    for (std::size_t k = 0; k < threads; ++k) {
      sessions_.push_back(made<Stacks>(plan));
      sessions_.back()->without_deadline();  // no world is late
    }
  }

  Batch(const Batch&) = delete;

  // q (count, nq), v (count, nv); written: commands (count, motors), status (count), residuals (count, levels), and x
  // (count, n) and notes (count) unless they are null.
  void step(const double* q, const double* v, const std::vector<BatchTarget>& targets, double* commands,
            std::int32_t* status, double* residuals, double* x, std::vector<NoteRecord>* notes = nullptr) {
    run({status, residuals, x, notes}, [&](std::size_t, Stacks& session, std::size_t i) -> const Tick& {
      for (const BatchTarget& target : targets)
        session.offer(target.element, target.what, target.values + i * target.size, target.size);
      const Line& line = session.current().line();
      const Tick& tick = session.step(q + i * std::size_t(line.nq()), v + i * std::size_t(line.nv()));
      std::copy(tick.command().begin(), tick.command().end(), commands + i * tick.command().size());
      return tick;
    });
  }

  struct Written {
    std::int32_t* status;
    double *residuals, *x;
    std::vector<NoteRecord>* notes = nullptr;
  };
  // One tick of each world i by one(thread, session, i), which returns it.
  template <class One>
  void run(const Written& written, const One& one) {
    std::atomic<std::size_t> next{0};
    const auto work = [&](std::size_t thread) {
      Stacks& session = *sessions_[thread];
      for (std::size_t from; (from = next.fetch_add(kChunk)) < worlds_.size();)
        for (std::size_t i = from; i < std::min(from + kChunk, worlds_.size()); ++i) {
          session.load(worlds_[i]);
          const Tick& tick = one(thread, session, i);
          double* const levels = written.residuals + i * session.levels();
          std::fill(std::copy(tick.residuals().begin(), tick.residuals().end(), levels), levels + session.levels(),
                    0.0);
          if (written.x) std::copy(tick.x().begin(), tick.x().end(), written.x + i * tick.x().size());
          if (written.notes) written.notes[i] = records(tick);
          written.status[i] = static_cast<std::int32_t>(tick.status());
          session.store(worlds_[i]);
        }
    };
    std::vector<std::thread> others;
    for (std::size_t k = 1; k < sessions_.size(); ++k) {
      try {
        others.emplace_back(work, k);
      } catch (const std::system_error&) {
        break;  // run with fewer threads
      }
    }
    work(0);
    for (std::thread& other : others) other.join();
  }

  // Sum over the ticks of all worlds; no gap: a world has no clock.
  Counts counters() const {
    Counts sum;
    for (const auto& session : sessions_) sum.add(session->current().timing().counters().counts());
    sum.longest_gap = 0.0;
    return sum;
  }

  void reset(std::size_t i) { worlds_[i].clear(); }
  // Change the session of a world between two steps.
  template <class Change>
  void change(std::size_t i, const Change& change) {
    sessions_[0]->load(worlds_[i]);
    change(*sessions_[0]);
    sessions_[0]->store(worlds_[i]);
  }
  void stop(std::size_t i, const std::string& reason) {
    change(i, [&](Stacks& session) { session.current().halt().stop(reason); });
  }
  void resume(std::size_t i) {
    change(i, [](Stacks& session) { session.current().halt().resume(); });
  }
  Batch& batch() { return *this; }
  std::size_t count() const { return worlds_.size(); }
  std::size_t threads() const { return sessions_.size(); }
  Stacks& session(std::size_t thread = 0) { return *sessions_[thread]; }
  std::size_t bytes() const {  // memory of all worlds
    std::size_t sum = 0;
    for (const auto& world : worlds_) sum += world.bytes();
    return sum;
  }

 private:
  static constexpr std::size_t kChunk = 16;  // worlds that a thread takes at a time

  std::vector<World> worlds_;
  std::vector<std::unique_ptr<Stacks>> sessions_;
};

}  // namespace hqp
