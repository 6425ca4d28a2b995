// A part of a plan, its arrays in the memory of one session.
#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "../rows/plan.hpp"
#include "foreign.hpp"
#include "parts.hpp"
#include "plan_file.hpp"

namespace hqp {

// The buffers of a plan as one session has them.
class Memory {
 public:
  explicit Memory(const Plan& plan) : plan_(plan), block_(plan.image().size() + 8) {
    const auto start = reinterpret_cast<std::uintptr_t>(block_.data());
    base_ = reinterpret_cast<char*>((start + 63) / 64 * 64);
    std::copy(plan.image().begin(), plan.image().end(), reinterpret_cast<double*>(base_));
  }
  Memory(const Memory&) = delete;

  template <class T>
  T* at(const Json& place, std::size_t count, char type) const {
    const std::vector<Json>& json = place["@"].items;
    if (json.size() != 3 || json[2].number != double(count))
      throw PlanError("an array of the plan needs " + std::to_string(count) + " items: export it anew");
    if (count == 0) return reinterpret_cast<T*>(base_);
    const double k = json[0].number, first = json[1].number;
    if (!(k >= 0.0 && k < double(plan_.buffers().size())))
      throw PlanError("an array of the plan names a buffer that does not exist: export it anew");
    const Plan::Buffer& buffer = plan_.buffers()[static_cast<std::size_t>(k)];
    if (buffer.type != type || !(first >= 0.0) || first + double(count) > double(buffer.size))
      throw PlanError("an array of the plan lies outside its buffer or has another type: export it anew");
    return reinterpret_cast<T*>(base_ + buffer.at) + static_cast<std::size_t>(first);
  }

 private:
  const Plan& plan_;
  std::vector<double> block_;
  char* base_;
};

class Node : public PlanOf<Node> {
 public:
  Node(const Json& json, const Memory& memory) : json_(&json), memory_(&memory) {}

  using PlanOf::doubles;
  using PlanOf::flag;
  using PlanOf::integer;
  using PlanOf::ints;
  using PlanOf::number;
  using PlanOf::numbers;
  using PlanOf::parts;

  std::string name() const { return (*json_)["class"].text; }
  const std::string& text(const char* field) const { return (*json_)[field].text; }
  bool is_none() const { return json_->kind == Json::Kind::kNone; }
  bool has(const char* field) const {
    const Json* found = json_->find(field);
    return found && found->kind != Json::Kind::kNone;
  }
  double number() const { return Plan::number_of(*json_); }
  int integer() const {
    const double found = number();
    if (!(found >= -2147483648.0 && found <= 2147483647.0))
      throw PlanError("a field of the plan is not a whole number of 32 bits: export it anew");
    return static_cast<int>(found);
  }
  bool flag() const { return json_->flag; }
  std::vector<int> ints() const {
    std::vector<int> found;
    for (const Json& one : items()) found.push_back(Node(one, *memory_).integer());
    return found;
  }
  std::vector<double> numbers() const {
    std::vector<double> found;
    for (const Json& one : items()) found.push_back(Plan::number_of(one));
    return found;
  }
  std::vector<std::string> texts(const char* field) const {
    std::vector<std::string> found;
    for (const Json& one : part(field).items()) found.push_back(one.text);
    return found;
  }
  Node part(const char* field) const { return {(*json_)[field], *memory_}; }
  std::vector<Node> parts() const {
    std::vector<Node> found;
    for (const Json& one : items()) found.emplace_back(one, *memory_);
    return found;
  }
  std::size_t size() const {  // items of an array
    const std::vector<Json>& json = (*json_)["@"].items;
    if (json.size() != 3 || !(json[2].number >= 0.0 && json[2].number < 1e9))
      throw PlanError("a field of the plan is not an array: export it anew");
    return static_cast<std::size_t>(json[2].number);
  }
  double* doubles(std::size_t count) const { return memory_->at<double>(*json_, count, 'd'); }
  const std::int64_t* longs(std::size_t count) const { return memory_->at<std::int64_t>(*json_, count, 'l'); }
  std::int8_t* bytes(std::size_t count) const { return memory_->at<std::int8_t>(*json_, count, 'b'); }
  std::int32_t* slots(int& rows) const {
    rows = static_cast<int>(size());
    return memory_->at<std::int32_t>(*json_, size(), 'i');
  }

 private:
  const std::vector<Json>& items() const {
    if (json_->kind != Json::Kind::kList) throw PlanError("a field of the plan is not a list: export it anew");
    return json_->items;
  }

  const Json* json_;
  const Memory* memory_;
};

// Make a thing of a part of the plan that a session's owner has added.  by: the call that writes the part.  Throws
// PlanError if the plan lacks the part or the part is inconsistent.
template <class Make>
auto of_part(const std::shared_ptr<const Plan>& plan, const Memory& memory, const std::string& part, const char* by,
             const Make& make) {
  if (!plan->root().find(part.c_str())) throw PlanError("the plan has no " + part + ": write it by " + by);
  try {
    return make(Node(plan->root(), memory).part(part.c_str()));
  } catch (const std::invalid_argument& error) {
    throw PlanError("the " + part + " of the plan is inconsistent (" + error.what() + "): export it anew");
  }
}

// Source of sessions from a file: they share the memory of the plan, the rows and the solver.
class FileSource {
 public:
  static constexpr bool kLive = false;
  FileSource(std::shared_ptr<const Plan> plan, std::shared_ptr<const Memory> memory, const Json& root)
      : plan_(std::move(plan)), memory_(std::move(memory)), root_(&root) {}
  explicit FileSource(std::shared_ptr<const Plan> plan)
      : FileSource(plan, std::make_shared<const Memory>(*plan), plan->root()) {}
  Node root() const { return {*root_, *memory_}; }
  const Parts& parts() const {
    if (!parts_) parts_ = std::make_shared<Parts>(made_of(root()));
    return *parts_;
  }
  Foreign* foreign() const { return nullptr; }
  std::shared_ptr<const void> kept() const {
    parts();
    return std::make_shared<FileSource>(*this);
  }

 private:
  std::shared_ptr<const Plan> plan_;
  std::shared_ptr<const Memory> memory_;
  const Json* root_;
  mutable std::shared_ptr<Parts> parts_;
};

}  // namespace hqp
