// A plan: the content of a file, from which sessions are made (docs/plan_file.md). Constant: sessions share it.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <iterator>
#include <memory>
#include <string>
#include <vector>

#include "../common/sha256.hpp"
#include "json.hpp"
#include "version.hpp"

namespace hqp {

class Plan {
 public:
  // Read the bytes of a file; throws PlanError for another format or version, for truncated or changed bytes, and with
  // a key for a signature that does not match.
  explicit Plan(const std::string& file, const std::string& key = "") {
    const std::size_t line = file.find('\n');
    if (file.compare(0, 9, "hqp plan,") != 0 || line == std::string::npos || line > 200)
      throw PlanError("not a plan file of hqp: it must begin with 'hqp plan,'; write one by hqp export");
    const std::string header = file.substr(0, line);
    const std::string_view body(file.data() + line + 1, file.size() - line - 1);
    if (field(header, "format ") != std::to_string(kFormat))
      throw PlanError("the plan has format " + field(header, "format ") + ", this version of hqp reads format " +
                      std::to_string(kFormat) + ": export it anew");
    if (field(header, "version ") != kVersion)
      throw PlanError("the plan was written by hqp " + field(header, "version ") + ", this is " + kVersion +
                      ": export it anew");
    if (field(header, "size ") != std::to_string(body.size()))
      throw PlanError("the plan is cut short: it has " + std::to_string(body.size()) + " bytes of " +
                      field(header, "size "));
    const std::string own = hash(body);
    if (field(header, "hash ") != own)
      throw PlanError("the plan was changed after it was written: its hash differs; export it anew");
    const std::string plain = "hqp plan, format " + std::to_string(kFormat) + ", version " + kVersion + ", size " +
                              std::to_string(body.size()) + ", hash " + own;
    const std::string signature = field(header, "hmac ");
    const bool bare = header == plain,
               hexadecimal = signature.find_first_not_of("0123456789abcdef") == std::string::npos;
    if (!bare && !(header == plain + ", hmac " + signature && signature.size() == 64 && hexadecimal))
      throw PlanError("the plan was changed: its first line must have format, version, size, hash and hmac only");
    if (!key.empty() && bare)
      throw PlanError("the plan is not signed, but a key is given: export it with that key, or load it without one");
    if (!key.empty() && !same(signature, hmac(key, body)))
      throw PlanError(
          "the plan was signed with another key or changed after it: export it anew with the key of this site");
    root_ = JsonReader(body).read();
    lay_out();
  }

  struct Buffer {
    char type;             // 'd' doubles, 'l' 64, 'i' 32 and 'b' 8 bits
    std::size_t at, size;  // its first byte in the image, and its items
  };
  const Json& root() const { return root_; }
  const std::string& fingerprint() const { return root_["robot"]["fingerprint"].text; }
  const std::vector<Buffer>& buffers() const { return buffers_; }
  const std::vector<double>& image() const { return image_; }  // the first contents of all buffers
  static std::size_t width(char type) { return type == 'b' ? 1 : type == 'i' ? 4 : 8; }

 private:
  static constexpr std::size_t kLargest = std::size_t{1} << 28;  // bytes of all buffers

  static std::string field(const std::string& header, const std::string& name) {
    const std::size_t at = header.find(name);
    if (at == std::string::npos) return "unknown";
    return header.substr(at + name.size(), header.find(',', at) - at - name.size());
  }
  static std::string hash(std::string_view body) {
    std::uint64_t found = 0xCBF29CE484222325u;
    for (const char c : body) found = (found ^ static_cast<unsigned char>(c)) * 0x100000001B3u;
    std::string text(16, '0');
    for (int i = 15; i >= 0; --i, found >>= 4) text[i] = "0123456789abcdef"[found & 15];
    return text;
  }

  void lay_out() {
    std::size_t used = 0;
    for (const Json& buffer : root_["buffers"].items) {
      const std::string& type = buffer["type"].text;
      const double size = buffer["size"].number;
      const char kind = type == "f8" ? 'd' : type == "i8" ? 'l' : type == "i4" ? 'i' : type == "i1" ? 'b' : '\0';
      if (!kind || !(size >= 0.0 && size < double(kLargest)))
        throw PlanError("a buffer of the plan has type '" + type + "' and size " + std::to_string(size) +
                        "; allowed: f8, i8, i4 or i1 and 0 to " + std::to_string(kLargest));
      buffers_.push_back({kind, used, static_cast<std::size_t>(size)});
      used += (static_cast<std::size_t>(size) * width(kind) + 63) / 64 * 64;
      if (used > kLargest)
        throw PlanError("the buffers of the plan are too large, allowed " + std::to_string(kLargest) + " bytes");
    }
    image_.assign(used / sizeof(double), 0.0);
    std::size_t k = 0;
    for (const Json& buffer : root_["buffers"].items) fill(buffers_[k++], buffer["runs"]);
  }
  void fill(const Buffer& buffer, const Json& runs) {
    for (const Json& run : runs.items) {
      if (run.items.size() != 2) throw PlanError("a run of a buffer must be [first, values]: export the plan anew");
      double at = run.items[0].number;
      if (!(at >= 0.0) || at + double(run.items[1].items.size()) > double(buffer.size))
        throw PlanError("a run of a buffer lies outside its buffer: export the plan anew");
      char* to = reinterpret_cast<char*>(image_.data()) + buffer.at + static_cast<std::size_t>(at) * width(buffer.type);
      for (const Json& one : run.items[1].items) {
        const double number = number_of(one);
        if (buffer.type != 'd' && !(std::fabs(number) < 2147483648.0))
          throw PlanError("an index of the plan is " + std::to_string(number) +
                          ", allowed less than 2^31 in magnitude");
        const auto whole = static_cast<std::int64_t>(buffer.type == 'd' ? 0.0 : number);
        if (buffer.type == 'd') put(to, number);
        else if (buffer.type == 'l') put(to, whole);
        else if (buffer.type == 'i') put(to, static_cast<std::int32_t>(whole));
        else put(to, static_cast<std::int8_t>(whole));
        to += width(buffer.type);
      }
    }
  }
  template <class T>
  static void put(char* to, T value) {
    std::memcpy(to, &value, sizeof(T));
  }

 public:
  // A number, or the text of one that is not finite.
  static double number_of(const Json& json) {
    if (json.kind == Json::Kind::kNumber) return json.number;
    if (json.text == "inf") return std::numeric_limits<double>::infinity();
    if (json.text == "-inf") return -std::numeric_limits<double>::infinity();
    if (json.text == "nan") return std::numeric_limits<double>::quiet_NaN();
    throw PlanError("a field of the plan is not a number: export it anew");
  }

 private:
  Json root_;
  std::vector<Buffer> buffers_;
  std::vector<double> image_;
};

// The plan of a file; throws PlanError with a sentence.
inline std::shared_ptr<const Plan> read_plan(const std::string& path, const std::string& key = "") {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw PlanError("cannot open the file " + path);
  return std::make_shared<const Plan>(std::string(std::istreambuf_iterator<char>(file), {}), key);
}

}  // namespace hqp
