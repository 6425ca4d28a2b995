// Reader for the JSON of plan files: output of Python's json.dumps, without escapes beyond ASCII.
#pragma once

#include <charconv>
#include <cstdlib>
#include <limits>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "errors.hpp"

namespace hqp {

struct Json {
  enum class Kind { kNone, kFlag, kNumber, kText, kList, kTable };

  Kind kind = Kind::kNone;
  bool flag = false;
  double number = 0.0;
  std::string text;
  std::vector<Json> items;
  std::vector<std::pair<std::string, Json>> fields;

  // The field of that name; throws PlanError if there is none.
  const Json& operator[](std::string_view name) const {
    if (const Json* found = find(name)) return *found;
    throw PlanError("the plan has no field '" + std::string(name) + "': export it anew");
  }
  const Json* find(std::string_view name) const {
    for (const auto& [key, value] : fields)
      if (key == name) return &value;
    return nullptr;
  }
};

class JsonReader {
 public:
  explicit JsonReader(std::string_view text) : text_(text) {}

  Json read() {
    Json found = value(0);
    space();
    if (at_ != text_.size()) refuse("text after the end of the value");
    return found;
  }

 private:
  static constexpr int kDeepest = 64;

  [[noreturn]] void refuse(const char* why) const {
    throw PlanError("the plan is not valid JSON at byte " + std::to_string(at_) + ": " + why);
  }
  void space() {
    while (at_ < text_.size() && (text_[at_] == ' ' || text_[at_] == '\n' || text_[at_] == '\t' || text_[at_] == '\r'))
      ++at_;
  }
  char next() {
    space();
    return at_ < text_.size() ? text_[at_] : '\0';
  }
  bool take(char c) {
    if (next() != c) return false;
    ++at_;
    return true;
  }
  void expect(char c) {
    if (!take(c)) refuse((std::string("expected '") + c + "'").c_str());
  }
  bool word(std::string_view name) {
    if (text_.substr(at_, name.size()) != name) return false;
    at_ += name.size();
    return true;
  }

  Json value(int depth) {
    if (depth > kDeepest) refuse("it is nested deeper than 64 levels");
    Json found;
    switch (next()) {
      case '{':
        ++at_;
        found.kind = Json::Kind::kTable;
        if (take('}')) return found;
        do {
          if (next() != '"') refuse("expected a name in quotes");
          std::string name = string();
          expect(':');
          found.fields.emplace_back(std::move(name), value(depth + 1));
        } while (take(','));
        expect('}');
        return found;
      case '[':
        ++at_;
        found.kind = Json::Kind::kList;
        if (take(']')) return found;
        do found.items.push_back(value(depth + 1));
        while (take(','));
        expect(']');
        return found;
      case '"':
        found.kind = Json::Kind::kText;
        found.text = string();
        return found;
      case 'n':
        if (!word("null")) refuse("expected null");
        return found;
      case 't':
      case 'f':
        found.kind = Json::Kind::kFlag;
        found.flag = text_[at_] == 't';
        if (!word(found.flag ? "true" : "false")) refuse("expected true or false");
        return found;
      default:
        found.kind = Json::Kind::kNumber;
        found.number = number();
        return found;
    }
  }

  std::string string() {
    std::string found;
    for (++at_; at_ < text_.size() && text_[at_] != '"'; ++at_) {
      if (text_[at_] != '\\') {
        found += text_[at_];
        continue;
      }
      if (++at_ == text_.size()) break;
      const char c = text_[at_];
      if (c == 'u') {
        if (at_ + 4 >= text_.size()) break;
        unsigned code = 0;
        const char* first = text_.data() + at_ + 1;
        if (std::from_chars(first, first + 4, code, 16).ptr != first + 4)
          refuse("expected four hexadecimal digits after \\u");
        append(found, code);
        at_ += 4;
      } else if (c == 'n' || c == 't') {
        found += c == 'n' ? '\n' : '\t';
      } else {
        found += c;
      }
    }
    if (at_ >= text_.size()) refuse("a string does not end");
    ++at_;
    return found;
  }
  static void append(std::string& text, unsigned code) {  // as UTF-8
    if (code < 0x80) {
      text += static_cast<char>(code);
    } else if (code < 0x800) {
      text += static_cast<char>(0xC0 | code >> 6);
      text += static_cast<char>(0x80 | (code & 0x3F));
    } else {
      text += static_cast<char>(0xE0 | code >> 12);
      text += static_cast<char>(0x80 | (code >> 6 & 0x3F));
      text += static_cast<char>(0x80 | (code & 0x3F));
    }
  }

  double number() {
    double found = 0.0;
    const char *first = text_.data() + at_, *last = text_.data() + text_.size();
    const auto [end, error] = std::from_chars(first, last, found);
    if (error != std::errc() || end == first) refuse("expected a number");
    at_ += static_cast<std::size_t>(end - first);
    return found;
  }

  std::string_view text_;
  std::size_t at_ = 0;
};

}  // namespace hqp
