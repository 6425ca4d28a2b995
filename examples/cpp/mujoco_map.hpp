// MuJoCo's numbers in the session's order: quaternions x y z w, the base's linear velocity in its own axes.
#pragma once

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include <mujoco/mujoco.h>

struct Map {
  std::vector<int> place, column, motor;  // by joint

  Map(const mjModel* m, const std::vector<std::string>& joints) {
    for (const std::string& name : joints) {
      const int joint = mj_name2id(m, mjOBJ_JOINT, name.c_str());
      const int* end = m->actuator_trnid + 2 * m->nu;
      int driven = 0;
      for (const int* a = m->actuator_trnid; a != end && *a != joint; a += 2) ++driven;
      if (joint < 0 || driven == m->nu) std::fprintf(stderr, "no motor for %s\n", name.c_str()), std::exit(2);
      place.push_back(m->jnt_qposadr[joint]), column.push_back(m->jnt_dofadr[joint]), motor.push_back(driven);
    }
  }
  void state(const mjData* d, double* q, double* v) const {
    const double* turn = d->qpos + 3;
    double back[4];
    mju_negQuat(back, turn);
    std::copy(d->qpos, d->qpos + 3, q);
    std::copy(turn + 1, turn + 4, q + 3), q[6] = turn[0];
    mju_rotVecQuat(v, d->qvel, back);
    std::copy(d->qvel + 3, d->qvel + 6, v + 3);
    for (std::size_t i = 0; i < place.size(); ++i) q[7 + i] = d->qpos[place[i]], v[6 + i] = d->qvel[column[i]];
  }
  // Configuration of the session, at rest.
  void put(mjData* d, const double* q) const {
    std::copy(q, q + 3, d->qpos);
    d->qpos[3] = q[6], std::copy(q + 3, q + 6, d->qpos + 4);
    for (std::size_t i = 0; i < place.size(); ++i) d->qpos[place[i]] = q[7 + i];
  }
  void drive(mjData* d, const double* command) const {
    for (std::size_t i = 0; i < motor.size(); ++i) d->ctrl[motor[i]] = command[i];
  }
};
