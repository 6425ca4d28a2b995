// Distances of pairs of shapes kept at a clearance; see tasks/collision.py for the equations.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "polytope.hpp"
#include "rows.hpp"

namespace hqp {

struct LinkCapsule {
  int body;
  Segment local;  // in the body's axes
  double radius;
  std::optional<Polytope> hull = {};  // the shape itself, in the body's axes, within the ball of this radius
};

enum class Solid { kCapsule, kBox, kHalfSpace };

struct WorldShape {
  Solid kind;
  Vec3 size;
};

struct CollisionScene {
  std::vector<LinkCapsule> links;
  std::vector<WorldShape> world;
  std::vector<std::string> names;        // links, then the world's shapes
  std::vector<std::vector<int>> chains;  // coordinates that move each body
  std::vector<std::array<int, 2>> pairs;
  std::vector<double> clearances;
  std::int32_t* slots;  // (m,) live: number of the pair or end in each row, -1 for none
  int rows;
  double influence, soft, curvature, rate, approach, braking, recovery, outset, foresight, step, dt;
  int order;
};

// A row is that of a pair, by its number n, or of an end of one of its capsules, n + k times the number of pairs: k = 1
// and 2 for the ends of the first, 3 and 4 of the second.
class Collision final : public Operation {
 public:
  Collision(Target out, const Tree& tree, CollisionScene scene)
      : out_(out),
        tree_(tree),
        s_(std::move(scene)),
        ends_(s_.links.size()),
        centres_(s_.links.size()),
        sizes_(s_.links.size()),
        speeds_(s_.links.size()),
        count_(static_cast<int>(s_.pairs.size())),
        near_(5 * s_.pairs.size(), kFar),
        left_(5 * s_.pairs.size(), kFar),
        found_(5 * s_.pairs.size()),
        fade_(5 * s_.pairs.size(), 1.0),
        beside_(s_.pairs.size(), 0.0),
        has_slot_(5 * s_.pairs.size(), false),
        old_(s_.rows, -1),
        deepest_(s_.chains.size() + s_.links.size() + s_.world.size(), 0.0) {
    for (std::size_t k = 0; k < s_.links.size(); ++k) {
      const Vec3 axis = s_.links[k].local.b - s_.links[k].local.a;
      sizes_[k] = 0.5 * std::sqrt(dot(axis, axis)) + s_.links[k].radius;
    }
    close_.reserve(near_.size());
    for (const auto& pair : s_.pairs) names_.push_back(s_.names[pair[0]] + " - " + s_.names[pair[1]]);
    last_.resize(s_.rows);
    for (const auto& pair : s_.pairs)
      chains_.push_back({apart(body(pair[0]), body(pair[1])), apart(body(pair[1]), body(pair[0]))});
  }

  void run(const double*, const double* v) override {
    place();
    look();
    assign();
    for (int i = 0; i < s_.rows; ++i) {
      write(i, v);
      const int n = s_.slots[i] < 0 ? -1 : s_.slots[i] % count_;
      last_[i] = n < 0 ? RowName{"free"} : RowName{names_[n].c_str(), near_[n]};
    }
    for (const int row : close_) {
      near_[row] = kFar, fade_[row] = 1.0, beside_[row % count_] = 0.0;
      for (const int k : pair_of(row)) deepest_[owner(k)] = 0.0;
    }
  }
  RowName row_name(int i) const override { return last_[i]; }
  void keep(CarryOver& state) override { state.take(s_.slots, static_cast<std::size_t>(s_.rows)); }

 private:
  static constexpr double kFar = std::numeric_limits<double>::infinity();
  // Squared sines of the angle of two axes between which rows of their ends fade out; axes that are points.
  static constexpr double kAligned = 0.03, kAcross = 0.12, kShort = 0.01;

  static constexpr double kHeld = 0.5;  // share of the release rate of pairs while a deeper one recovers

  const std::array<int, 2>& pair_of(int row) const { return s_.pairs[row % count_]; }
  bool is_link(int k) const { return k < static_cast<int>(s_.links.size()); }
  bool is_capsule(int k) const {
    return is_link(k) ? !s_.links[k].hull : s_.world[k - s_.links.size()].kind == Solid::kCapsule;
  }
  int body(int k) const { return is_link(k) ? s_.links[k].body : 0; }
  // Carrier of a shape: its body, itself in the world.
  std::size_t owner(int k) const { return body(k) ? body(k) : s_.chains.size() + k; }
  std::vector<int> apart(int one, int two) const {  // coordinates that move the first body only
    std::vector<int> found;
    for (const int c : s_.chains[one])
      if (std::find(s_.chains[two].begin(), s_.chains[two].end(), c) == s_.chains[two].end()) found.push_back(c);
    return found;
  }

  void place() {
    for (std::size_t k = 0; k < s_.links.size(); ++k) {
      const LinkCapsule& link = s_.links[k];
      const Body& b = tree_.bodies()[link.body];
      const Vec3 p = load(b.position);
      const Mat3 R = load_rotation(b.rotation);
      ends_[k] = {p + R * link.local.a, p + R * link.local.b};
      centres_[k] = 0.5 * (ends_[k].a + ends_[k].b);
      const Motion& V = tree_.motion(link.body);
      const Vec3 there = V.at(centres_[k]);
      speeds_[k] = std::sqrt(dot(there, there)) + sizes_[k] * std::sqrt(dot(V.angular, V.angular));
    }
  }

  void look() {
    close_.clear();
    const double slow = closing(s_.soft).speed;
    for (std::size_t n = 0; n < s_.pairs.size(); ++n) {
      const auto [i, j] = s_.pairs[n];
      double limit = kFar;  // distances above it have no row
      if (is_link(j)) {
        const Vec3 w = centres_[i] - centres_[j];
        const double size = sizes_[i] + sizes_[j], reach = s_.influence + size;
        const double most = s_.foresight * (speeds_[i] + speeds_[j]);
        if (!(dot(w, w) < reach * reach) &&
            !(most > slow && most > closing(std::sqrt(dot(w, w)) - size - s_.clearances[n]).speed))
          continue;
        if (!(most > slow)) limit = s_.influence;
      }
      const Distance found = measure(static_cast<int>(n), ends_[i], is_link(j) ? ends_[j] : Segment{}, 0.0, -1, limit);
      if (!take(static_cast<int>(n), found)) continue;
      if (is_capsule(j)) look_at_ends(static_cast<int>(n));
    }
  }

  // Take a row within the influence, or one that closes fast.
  bool take(int row, const Distance& found) {
    const double h = found.value - s_.clearances[row % count_], closed = std::max(-rate(row, found, 0.0), 0.0);
    if (!(found.value < s_.influence) && !(s_.foresight * closed > closing(h).speed)) return false;
    near_[row] = found.value;
    left_[row] = h - 0.5 * closed * closed / s_.braking;
    found_[row] = found;
    close_.push_back(row);
    if (h < 0.0)
      for (const int k : pair_of(row)) deepest_[owner(k)] = std::min(deepest_[owner(k)], h);
    return true;
  }

  void look_at_ends(int n) {
    const auto [i, j] = s_.pairs[n];
    const Segment& one = ends_[i];
    const Segment two = is_link(j) ? ends_[j] : world_axis(j, 0.0);
    const Vec3 u = one.b - one.a, v = two.b - two.a;
    const double A = dot(u, u), B = dot(u, v), C = dot(v, v);
    if (!(std::min(A, C) > kShort * kShort)) return;
    const double fade = std::min(1.0, (kAcross - (1.0 - B * B / (A * C))) / (kAcross - kAligned));
    if (!(fade > 0.0)) return;
    beside_[n] = fade;
    for (int k = 1; k <= 4; ++k) {
      const int row = n + k * count_;
      if (take(row, measure(row, one, two))) fade_[row] = fade;
    }
  }

  Segment world_axis(int j, double h) const {  // axis of a capsule of the world, a time h later
    const double* T = pose(j);
    const Vec3 origin = Vec3{T[3], T[7], T[11]} + h * load(T + 16), axis{T[2], T[6], T[10]};
    const Vec3 half = 0.5 * s_.world[j - s_.links.size()].size[1] * (axis + h * cross(load(T + 20), axis));
    return {origin - half, origin + half};
  }

  // Position and rotation of the body of a link a time h later.
  std::pair<Vec3, Mat3> placed(int k, double h) const {
    const Body& b = tree_.bodies()[body(k)];
    const Motion& V = tree_.motion(body(k));
    const Vec3 origin = load(b.position);
    Mat3 R = load_rotation(b.rotation);
    for (Vec3& column : R.column) column = column + h * cross(V.angular, column);
    return {origin + h * V.at(origin), R};
  }

  // h: time offset of the world's shapes and of hulls.  feature: number of a hull's feature, -1 for the nearest. limit:
  // a larger distance may be infinite.
  Distance measure(int row, Segment one, Segment two, double h = 0.0, int feature = -1, double limit = kFar) const {
    const auto [i, j] = pair_of(row);
    const int end = row / count_;
    const double radius = s_.links[i].radius;
    if (!is_link(j) && s_.world[j - s_.links.size()].kind == Solid::kCapsule) two = world_axis(j, h);
    if (end == 1) one.b = one.a;
    if (end == 2) one.a = one.b;
    if (end == 3) two.b = two.a;
    if (end == 4) two.a = two.b;
    if (is_link(j) && s_.links[j].hull) {
      const auto [origin, R] = placed(j, h);
      const Polytope& hull = *s_.links[j].hull;
      return feature < 0 ? hull.distance(one, radius, origin, R, limit)
                         : hull.distance(feature, one, radius, origin, R);
    }
    if (is_link(j)) return Measure::capsule(one, radius, two, s_.links[j].radius);
    const std::size_t k = j - s_.links.size();
    const double* T = pose(j);
    const Vec3 turn = h * load(T + 20), origin = Vec3{T[3], T[7], T[11]} + h * load(T + 16);
    Mat3 R{{{T[0], T[4], T[8]}, {T[1], T[5], T[9]}, {T[2], T[6], T[10]}}};
    for (Vec3& column : R.column) column = column + cross(turn, column);
    const WorldShape& shape = s_.world[k];
    if (shape.kind == Solid::kHalfSpace) return Measure::half_space(one, radius, origin, R);
    if (shape.kind == Solid::kBox) return Measure::box(one, radius, 0.5 * shape.size, origin, R);
    return Measure::capsule(one, radius, two, shape.size[0]);
  }

  // A pair keeps its slot while it is near; others get free slots, then those of pairs with more way left.
  void assign() {
    for (int k = 0; k < s_.rows; ++k) {
      if (s_.slots[k] >= 0 && near_[s_.slots[k]] == kFar) s_.slots[k] = -1;
      if (s_.slots[k] >= 0) has_slot_[s_.slots[k]] = true;
    }
    int free = 0;  // slots before it are taken
    for (const int row : close_) {
      if (has_slot_[row]) continue;
      while (free < s_.rows && s_.slots[free] >= 0) ++free;
      int slot = free;
      if (slot == s_.rows) {
        slot = 0;
        for (int k = 1; k < s_.rows; ++k)
          if (left_[s_.slots[k]] > left_[s_.slots[slot]]) slot = k;
        if (!(left_[s_.slots[slot]] > left_[row])) continue;
        has_slot_[s_.slots[slot]] = false;
      }
      s_.slots[slot] = row;
      has_slot_[row] = true;
    }
    for (const int row : close_) has_slot_[row] = false;
  }

  void write(int i, const double* v) {
    const int row = s_.slots[i];
    double* J = out_.row(i);
    if (old_[i] >= 0 && old_[i] != row)
      for (const auto& chain : chains_[old_[i] % count_])
        for (const int c : chain) J[c] = 0.0;
    old_[i] = row;
    out_.upper[i] = kFar;
    out_.lower[i] = -kFar;
    if (out_.drift) out_.drift[i] = 0.0;
    if (row < 0) return;
    const Distance& found = found_[row];
    const auto& chains = chains_[row % count_];
    const Form form = along(found.normal, found.point);
    for (const int c : chains[0]) J[c] = -out_.weight * value(form, c);
    for (const int c : chains[1]) J[c] = out_.weight * value(form, c);
    const double clearance = s_.clearances[row % count_], loose = s_.rate * s_.influence * (1.0 / fade_[row] - 1.0);
    if (s_.order == 2) {
      out_.lower[i] = braking(row, clearance, rate(row, found, 0.0)) - s_.approach * loose - drift(row);
      return;
    }
    const int other = pair_of(row)[1];
    const double carried = is_link(other) ? 0.0 : dot(found.normal, motion(other).at(found.point));
    double least = approach(row, clearance);
    if (found.value < clearance) {  // a return sets in gradually
      double speed = carried;
      for (const auto& chain : chains)
        for (const int c : chain) speed += J[c] * v[c] / out_.weight;
      least = std::min(
          least, speed + s_.dt * s_.outset + std::min(1.0, s_.dt * (s_.approach + s_.rate)) * std::max(-speed, 0.0));
    }
    out_.lower[i] = least - loose - carried;
  }

  double value(const Form& form, int column) const {
    const double* t = tree_.twist(column);
    return dot(form.linear, load(t)) + dot(form.angular, load(t + 3));
  }

  // The speed with which a pair comes out, and that of the deepest one with which it shares a body or shape.
  std::array<double, 2> back(int row, double h) const {
    const auto [i, j] = pair_of(row);
    const double deepest = std::min(deepest_[owner(i)], deepest_[owner(j)]);
    const double most = std::min(-s_.rate * deepest, s_.recovery);
    return {std::min(-s_.rate * h, std::max(s_.rate * h, most - kHeld * s_.rate * (h - deepest))), most};
  }

  struct Speed {
    double speed, slope;
  };
  // Largest speed at which a pair closes a way h >= 0 outside its clearance, and its slope: see CollisionAvoidance.
  Speed closing(double h) const {
    const double L = s_.soft, within = std::min(h, L), r2 = s_.rate * s_.rate;
    const double root = std::sqrt(r2 + s_.curvature * within * within);
    if (h < L) return {h * root, (r2 + 2.0 * s_.curvature * h * h) / root};
    const double speed = std::sqrt(L * root * L * root + 2.0 * s_.braking * (h - L));
    return {speed, s_.braking / speed};
  }

  double approach(int row, double clearance) const {  // least rate of the distance
    const double h = found_[row].value - clearance;
    return h < 0.0 ? back(row, h)[0] : -closing(h).speed;
  }

  double braking(int row, double clearance, double speed) const {  // least acceleration of the distance
    const double h = found_[row].value - clearance, fast = s_.approach;
    if (h < 0.0) {
      const auto [wanted, most] = back(row, h);
      const double least = fast * (wanted - speed) - s_.rate * (speed - (most >= s_.recovery ? most : 0.0));
      return std::min(least, s_.outset + (fast + s_.rate) * std::max(-speed, 0.0));
    }
    const Speed most = closing(h);
    return -most.slope * speed - fast * (most.speed + speed);
  }

  // Change of the rate at zero acceleration. For capsules side by side it departs from that of the nearest end, whose
  // row sees it, by a bound that grows from the end on; see tasks/collision_motion.py.
  double drift(int row) const {
    constexpr double kSlide = 2.0;
    const double beside = row < count_ ? beside_[row] : 0.0;
    const std::optional<double> own = sliding(row);
    if (beside == 0.0) return own ? *own : held(row);
    double way;
    const std::optional<double> slides = sliding(row + nearest_end(row, way) * count_);
    const double end = slides ? *slides : held(row);
    const double most = 2.0 * way * kSlide * s_.outset * (1.0 / beside - 1.0);
    return end + std::min(std::max(own.value_or(end) - end, -most), most);
  }

  // With bodies moved by their velocities for a moment either way, to the feature of a hull that is nearest now; none
  // if the nearest point or the normal jumps in between.
  std::optional<double> sliding(int row) const {
    constexpr double kJump = 0.01, kTurn = 0.9;
    const auto [i, j] = pair_of(row);
    const double h = s_.step;
    const int feature = found_[row].feature;
    const Distance ends[2] = {measure(row, moved(i, h), is_link(j) ? moved(j, h) : Segment{}, h, feature),
                              measure(row, moved(i, -h), is_link(j) ? moved(j, -h) : Segment{}, -h, feature)};
    const Vec3 slid = ends[0].point - ends[1].point;
    if (dot(slid, slid) > kJump * kJump || dot(ends[0].normal, ends[1].normal) < kTurn) return {};
    return (rate(row, ends[0], h) - rate(row, ends[1], -h)) / (2.0 * h);
  }
  double held(int row) const {  // with the points that are nearest now
    const auto [i, j] = pair_of(row);
    const Distance& now = found_[row];
    return dot(now.normal, point_drift(j, now.point) - point_drift(i, now.point));
  }

  // The end that is nearest to the nearest points of two capsules, 1 to 4, and its way from there over the axis'
  // length.
  int nearest_end(int row, double& way) const {
    const auto [i, j] = pair_of(row);
    double s, t;
    Measure::nearest(ends_[i], is_link(j) ? ends_[j] : world_axis(j, 0.0), s, t);
    const double ways[4] = {s, 1.0 - s, t, 1.0 - t};
    const double* least = std::min_element(ways, ways + 4);
    way = *least;
    return 1 + static_cast<int>(least - ways);
  }
  double rate(int row, const Distance& found, double h) const {  // rate of a pair's distance, after a time h
    const auto [i, j] = pair_of(row);
    return dot(found.normal, velocity(j, h, found.point) - velocity(i, h, found.point));
  }
  Segment moved(int k, double h) const {
    const Motion& V = tree_.motion(body(k));
    return {ends_[k].a + h * V.at(ends_[k].a), ends_[k].b + h * V.at(ends_[k].b)};
  }
  Vec3 velocity(int k, double h, const Vec3& p) const { return motion(k).at(p) + h * motion_rate(k).at(p); }
  Vec3 point_drift(int k, const Vec3& p) const {
    const Motion V = motion(k);
    return motion_rate(k).at(p) + cross(V.angular, V.at(p));
  }

  // A shape of the world: pose (4, 4) row-major, velocity of the origin and angular velocity, three of four numbers.
  const double* pose(int k) const { return out_.reference + 24 * (k - s_.links.size()); }
  Motion motion(int k) const {
    if (is_link(k)) return tree_.motion(body(k));
    const double* T = pose(k);
    const Vec3 turn = load(T + 20);
    return {load(T + 16) - cross(turn, {T[3], T[7], T[11]}), turn};
  }
  Motion motion_rate(int k) const {  // at zero acceleration
    if (is_link(k)) return tree_.drift(body(k));
    const double* T = pose(k);
    return {-1.0 * cross(load(T + 20), load(T + 16)), {}};
  }

  Target out_;
  const Tree& tree_;
  CollisionScene s_;
  std::vector<Segment> ends_;
  std::vector<Vec3> centres_;
  std::vector<double> sizes_;   // half lengths with radius
  std::vector<double> speeds_;  // largest speed of a link's capsule
  int count_;                   // number of pairs
  std::vector<double> near_;    // distance for each row, infinite for rows that are not taken
  std::vector<double> left_;    // distance less clearance and braking distance
  std::vector<Distance> found_;
  std::vector<double> fade_;        // share of rows of ends, 1 for others
  std::vector<double> beside_;      // share of a pair's rows of ends, 0 for none
  std::vector<char> has_slot_;      // within assign: rows with a slot
  std::vector<std::string> names_;  // of pairs
  std::vector<RowName> last_;       // of rows
  std::vector<int> old_, close_;
  std::vector<double> deepest_;  // by owner: least distance less clearance of its pairs that are inside, 0 for none
  std::vector<std::array<std::vector<int>, 2>> chains_;
};

}  // namespace hqp
