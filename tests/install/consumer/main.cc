#include <cstdio>

#include "s3lam/eval/trajectory_error.h"
#include "s3lam/io/trajectory.h"

// Compares the trajectory it is given with itself.
int main(int argc, char** argv) {
  if (argc != 2) return 2;
  const s3lam::Trajectory trajectory = s3lam::ReadTrajectory(argv[1]);
  const auto errors = s3lam::CompareTrajectories(trajectory, trajectory);
  if (!errors || errors->ate_translation.rmse > 1e-12) return 1;
  std::printf("%zu poses\n", errors->num_pairs);
  return 0;
}
