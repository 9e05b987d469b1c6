// Bundle adjustment of a BAL file by Ceres: the peer of benchmarks/bundle.py.
//
//   ceres_bundle <file> [threads] [function tolerance]
//
// Prints one line of JSON. The camera model is that of the data set (Agarwal, Snavely, Seitz and Szeliski 2010):
// rotation vector, translation, focal length and two distortion coefficients; image axes point away from the camera.

#include <sys/resource.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <vector>

#include <ceres/ceres.h>
#include <ceres/rotation.h>

struct Reprojection {
  double u, v;

  template <typename T>
  bool operator()(const T* camera, const T* point, T* residual) const {
    T p[3];
    ceres::AngleAxisRotatePoint(camera, point, p);
    p[0] += camera[3];
    p[1] += camera[4];
    p[2] += camera[5];
    const T x = -p[0] / p[2];
    const T y = -p[1] / p[2];
    const T r2 = x * x + y * y;
    const T d = camera[6] * (1.0 + r2 * (camera[7] + camera[8] * r2));
    residual[0] = d * x - u;
    residual[1] = d * y - v;
    return true;
  }
};

int main(int count, char** words) {
  if (count < 2) {
    std::cerr << "usage: ceres_bundle <file> [threads] [function tolerance]\n";
    return 2;
  }
  const auto began = std::chrono::steady_clock::now();
  std::ifstream file(words[1]);
  std::size_t cameras = 0, points = 0, rows = 0;
  file >> cameras >> points >> rows;
  std::vector<std::size_t> camera(rows), point(rows);
  std::vector<double> seen(2 * rows), numbers(9 * cameras + 3 * points);
  for (std::size_t i = 0; i < rows; ++i) file >> camera[i] >> point[i] >> seen[2 * i] >> seen[2 * i + 1];
  for (double& number : numbers) file >> number;
  if (!file) {
    std::cerr << "not a BAL file: " << words[1] << "\n";
    return 1;
  }

  ceres::Problem problem;
  double* const first_point = numbers.data() + 9 * cameras;
  for (std::size_t i = 0; i < rows; ++i) {
    auto* cost = new ceres::AutoDiffCostFunction<Reprojection, 2, 9, 3>(new Reprojection{seen[2 * i], seen[2 * i + 1]});
    problem.AddResidualBlock(cost, nullptr, numbers.data() + 9 * camera[i], first_point + 3 * point[i]);
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_SCHUR;
  options.num_threads = count > 2 ? std::atoi(words[2]) : 1;
  options.max_num_iterations = 500;
  options.function_tolerance = count > 3 ? std::atof(words[3]) : options.function_tolerance;
  options.gradient_tolerance = 0.0;
  options.parameter_tolerance = 0.0;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);

  const std::chrono::duration<double> whole = std::chrono::steady_clock::now() - began;
  rusage used;
  getrusage(RUSAGE_SELF, &used);
  const auto iterations = summary.num_successful_steps + summary.num_unsuccessful_steps;
  std::printf(
      "{\"version\": \"%s\", \"cost\": %.17g, \"iterations\": %d, \"solve\": %.6f, \"minimiser\": %.6f, "
      "\"preprocessor\": %.6f, \"linear\": %.6f, \"kernels\": %.6f, \"whole\": %.6f, \"memory\": %.1f, \"converged\": %s}\n",
      CERES_VERSION_STRING, summary.final_cost, iterations, summary.total_time_in_seconds,
      summary.minimizer_time_in_seconds, summary.preprocessor_time_in_seconds, summary.linear_solver_time_in_seconds,
      summary.residual_evaluation_time_in_seconds + summary.jacobian_evaluation_time_in_seconds, whole.count(),
      used.ru_maxrss / 1024.0, summary.termination_type == ceres::CONVERGENCE ? "true" : "false");
  return 0;
}
