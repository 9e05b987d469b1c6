"""A reprojection row (2 values, 12 unknowns) as SymForce and Ceres compute it: generated C++ and automatic derivatives.

Needs g++ with Eigen, and Ceres' headers for the second. ``answer`` also returns values, for comparison with ours.
"""

from __future__ import annotations

import subprocess
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.peers import last_line, main

FLAGS = {"-O3": ("-O3",), "-O3 -march=native": ("-O3", "-march=native")}
EIGEN = "/usr/include/eigen3"
HARNESS = """
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <vector>
#include <algorithm>
{head}
// Rows of a file: 12 unknowns, then x y z u v a row; the time of a row and the sums of values and derivatives.
int main(int count, char** words) {{
  std::FILE* file = std::fopen(words[1], "rb");
  double unknowns[12];
  std::vector<double> rows;
  double row[5];
  if (count < 2 || !file || std::fread(unknowns, 8, 12, file) != 12) return 1;
  while (std::fread(row, 8, 5, file) == 5) rows.insert(rows.end(), row, row + 5);
  const long n = static_cast<long>(rows.size()) / 5;
  std::vector<double> values(2 * n), slopes(24 * n);
  double best = 1e300;
  for (int turn = 0; turn < 200; ++turn) {{
    const auto began = std::chrono::steady_clock::now();
    for (long i = 0; i < n; ++i) {{
      asm volatile("" : : "r"(unknowns) : "memory");  // each row is a factor with unknowns of its own
      {body}
    }}
    const auto ended = std::chrono::steady_clock::now();
    best = std::min(best, std::chrono::duration<double>(ended - began).count() / n);
  }}
  double sums[2] = {{0, 0}};
  for (double v : values) sums[0] += v * v;
  for (double v : slopes) sums[1] += v * v;
  std::printf("%.17g %.17g %.17g\\n", 1e9 * best, sums[0], sums[1]);
}}
"""
CERES = """
#include <ceres/jet.h>
template <typename T>
void residual(const T* s, const double* m, T* out) {
  using std::sin; using std::cos;
  const T ca = cos(s[6]), sa = sin(s[6]), cb = cos(s[7]), sb = sin(s[7]), cc = cos(s[8]), sc = sin(s[8]);
  const T y1 = ca * m[1] - sa * m[2], z1 = sa * m[1] + ca * m[2];
  const T x2 = cb * m[0] + sb * z1, z = -sb * m[0] + cb * z1 + s[11];
  const T x = (cc * x2 - sc * y1 + s[9]) / z, y = (sc * x2 + cc * y1 + s[10]) / z;
  const T square = x * x + y * y;
  const T bent = 1.0 + square * (s[4] + square * s[5]);
  out[0] = (s[0] * x * bent + s[2] - m[3]) / 0.5;
  out[1] = (s[1] * y * bent + s[3] - m[4]) / 0.5;
}
"""
CERES_BODY = """
      using Jet = ceres::Jet<double, 12>;
      Jet s[12], out[2];
      for (int k = 0; k < 12; ++k) s[k] = Jet(unknowns[k], k);
      residual(s, &rows[5 * i], out);
      for (int k = 0; k < 2; ++k) {
        values[2 * i + k] = out[k].a;
        for (int j = 0; j < 12; ++j) slopes[24 * i + 12 * k + j] = out[k].v[j];
      }
"""
SYMFORCE_BODY = """
      const Eigen::Map<const Eigen::Matrix<double, 12, 1>> s(unknowns);
      const Eigen::Map<const Eigen::Matrix<double, 5, 1>> m(&rows[5 * i]);
      Eigen::Matrix<double, 2, 12> J;
      Eigen::Map<Eigen::Matrix<double, 2, 1>> r(&values[2 * i]);
      r = sym::ReprojectionWithJacobian0<double>(s, m, &J);
      Eigen::Map<Eigen::Matrix<double, 2, 12>>{&slopes[24 * i]} = J;
"""


def symforce_header(folder: Path) -> str:
    """The C++ function that SymForce generates for a row."""
    import symforce

    symforce.set_epsilon_to_number(0.0)
    import symforce.symbolic as sf
    from symforce import codegen

    def reprojection(s, m):
        ca, sa, cb, sb = sf.cos(s[6]), sf.sin(s[6]), sf.cos(s[7]), sf.sin(s[7])
        cc, sc = sf.cos(s[8]), sf.sin(s[8])
        y1, z1 = ca * m[1] - sa * m[2], sa * m[1] + ca * m[2]
        x2, z = cb * m[0] + sb * z1, -sb * m[0] + cb * z1 + s[11]
        x, y = (cc * x2 - sc * y1 + s[9]) / z, (sc * x2 + cc * y1 + s[10]) / z
        square = x * x + y * y
        bent = 1 + square * (s[4] + square * s[5])
        return sf.V2((s[0] * x * bent + s[2] - m[3]) * 2, (s[1] * y * bent + s[3] - m[4]) * 2)

    made = codegen.Codegen.function(
        func=reprojection, input_types=[type(sf.Matrix(12, 1)), sf.V5], config=codegen.CppConfig()
    )
    made = made.with_jacobians(which_args=["s"], include_results=True)
    files = made.generate_function(output_dir=folder, skip_directory_nesting=True).generated_files
    return f'#include <Eigen/Core>\n#include "{next(f for f in files if f.suffix == ".h")}"\n'


def measured(folder: Path, head: str, body: str, data: Path) -> dict[str, dict[str, float]]:
    """Nanoseconds a row, and the sums of squares of values and derivatives, by compiler flags."""
    source, found = folder / "row.cpp", {}
    source.write_text(HARNESS.format(head=head, body=body))
    for name, flags in FLAGS.items():
        program = folder / "row"
        command = ["g++", "-std=c++17", *flags, "-DNDEBUG", f"-I{EIGEN}", str(source), "-o", str(program)]
        built = subprocess.run(command, capture_output=True, text=True, check=False)
        if built.returncode:
            errors = [line for line in built.stderr.splitlines() if "error" in line]
            raise RuntimeError(last_line("\n".join(errors[:1]) or built.stderr))
        run = subprocess.run([str(program), str(data)], capture_output=True, text=True, check=True)
        found[name] = dict(zip(("nanoseconds", "values", "slopes"), map(float, run.stdout.split()), strict=True))
    return found


def answer(arrays: dict[str, np.ndarray]) -> dict[str, dict[str, dict[str, float]]]:
    """``unknowns`` (12,), ``rows`` (n, 5) → for each peer and set of flags the nanoseconds a row, sums of squares."""
    found = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        data = folder / "rows.bin"
        data.write_bytes(np.concatenate([arrays["unknowns"], arrays["rows"].ravel()]).astype("<f8").tobytes())
        found["SymForce"] = measured(folder, symforce_header(folder), SYMFORCE_BODY, data)
        found["Ceres, automatic"] = measured(folder, CERES, CERES_BODY, data)
    return found


if __name__ == "__main__":
    main(answer)
