// A plan's file with random damage: expect a PlanError.  With --resealed the damaged file has a correct hash: expect a
// PlanError or a session that steps.  For sanitizers: damaged [--resealed] COUNT FILE.hqp ...
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include <plan_file.hpp>
#include <session.hpp>

namespace {

std::string whole(const std::string& body) {
  std::uint64_t hash = 0xCBF29CE484222325u;
  for (const char c : body) hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001B3u;
  char head[160];
  std::snprintf(head, sizeof head, "hqp plan, format %d, version %s, size %zu, hash %016llx\n", hqp::kFormat,
                hqp::kVersion, body.size(), static_cast<unsigned long long>(hash));
  return head + body;
}

// Delete, insert, change or swap bytes, replace digits, and replace numbers by extreme ones.
std::string damaged(const std::string& body, std::mt19937& random) {
  static const char* const kStrange[] = {"-1",      "0",  "1e300", "99999999", "2147483648", "\"nan\"",
                                         "\"inf\"", "[]", "{}",    "null",     "true",       "-0.5"};
  std::string found = body;
  const int times = 1 + int(random() % 3);
  for (int k = 0; k < times && found.size() > 20; ++k) {
    const std::size_t at = random() % (found.size() - 10), size = 1 + random() % 8;
    switch (random() % 6) {
      case 0:
        found.erase(at, size);
        break;
      case 1:
        found.insert(at, found.substr(random() % (found.size() - 10), size));
        break;
      case 2:
        found[at] = char(random() % 256);
        break;
      case 3:
        found.resize(at);
        break;
      default: {
        const std::size_t begin = found.find_first_of("0123456789", at);
        if (begin == std::string::npos) break;
        const std::size_t end = found.find_first_not_of("0123456789.eE+-", begin);
        if (random() % 2) found[begin] = char('0' + random() % 10);
        else found.replace(begin, end - begin, kStrange[random() % (sizeof kStrange / sizeof *kStrange)]);
      }
    }
  }
  return found;
}

// Ticks at rest and in motion, with targets, without elements, with an invalid state, and after a reset.
void run(hqp::Session& session) {
  const std::vector<double> q = session.home(), rest(std::size_t(session.nv()), 0.0);
  const std::vector<double> moving(rest.size(), 0.01), none(rest.size(), NAN);
  const auto each = [&](auto tell) {
    for (const std::string& name : session.names()) {
      hqp::Reference reference = session.reference(name);
      try {
        tell(reference);
      } catch (const hqp::ReferenceError&) {  // a contact's force follows phases
      }
    }
    session.step(q, moving);
  };
  for (int round = 0; round < 2; ++round) {
    session.step(q, rest, 0.0, 1.0);
    each([](hqp::Reference& reference) { reference.at(std::vector<double>(reference.size(), 0.1)); });
    each([](hqp::Reference& reference) { reference.on(false); });
    for (int tick = 0; tick < 2; ++tick) session.step(q, none);
    session.reset();
  }
}

}  // namespace

int main(int argc, char** argv) {
  const bool resealed = argc > 1 && std::string(argv[1]) == "--resealed";
  const int first = resealed ? 2 : 1;
  if (argc < first + 2) return 2;
  std::mt19937 random(1);
  for (int k = first + 1; k < argc; ++k) {
    std::ifstream file(argv[k], std::ios::binary);
    const std::string content(std::istreambuf_iterator<char>(file), {});
    const std::string body = content.substr(content.find('\n') + 1);
    int refused = 0, stepped = 0, same = 0;
    const int count = std::atoi(argv[first]);
    for (int i = 0; i < count; ++i) {
      const std::string given = resealed ? whole(damaged(body, random)) : damaged(content, random);
      same += given == content;
      try {
        hqp::Session session(std::make_shared<const hqp::Plan>(given));
        run(session);
        ++stepped;
      } catch (const hqp::PlanError&) {
        ++refused;
      }
    }
    std::printf("%s: %d of %d refused, %d stepped\n", argv[k], refused, count, stepped);
    if (resealed ? refused == 0 : refused + same != count) return 1;
  }
  return 0;
}
