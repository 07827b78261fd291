#include "engine/numerics/elementary.h"

#include <bit>
#include <cmath>
#include <cstdint>
#include <initializer_list>
#include <limits>

namespace sulcus {
namespace {

constexpr double nan_value = std::numeric_limits<double>::quiet_NaN();
constexpr double pi = 3.14159265358979323846;

// pi/2 in three parts, the first two with trailing zeros, so that k * part is exact for |k| < 2^20.
constexpr double half_pi_1 = 0x1.921fb544p+0;
constexpr double half_pi_2 = 0x1.0b4611a6p-34;
constexpr double half_pi_3 = 0x1.3198a2e037073p-69;

// Taylor sums on |x| <= pi/4.
double sin_small(double x) {
  const double t = x * x;
  double sum = 1.0 / 355687428096000.0;
  sum = sum * t - 1.0 / 1307674368000.0;
  sum = sum * t + 1.0 / 6227020800.0;
  sum = sum * t - 1.0 / 39916800.0;
  sum = sum * t + 1.0 / 362880.0;
  sum = sum * t - 1.0 / 5040.0;
  sum = sum * t + 1.0 / 120.0;
  sum = sum * t - 1.0 / 6.0;
  return x + x * (t * sum);
}

double cos_small(double x) {
  const double t = x * x;
  double sum = 1.0 / 20922789888000.0;
  sum = sum * t - 1.0 / 87178291200.0;
  sum = sum * t + 1.0 / 479001600.0;
  sum = sum * t - 1.0 / 3628800.0;
  sum = sum * t + 1.0 / 40320.0;
  sum = sum * t - 1.0 / 720.0;
  sum = sum * t + 1.0 / 24.0;
  return 1.0 - (0.5 * t - t * t * sum);
}

struct Reduced {
  double remainder;  // in [-pi/4, pi/4]
  int quadrant;      // 0..3
};

Reduced reduce_to_quadrant(double x) {
  const double k = std::floor(x * (2.0 / pi) + 0.5);
  const double remainder = ((x - k * half_pi_1) - k * half_pi_2) - k * half_pi_3;
  return {remainder, static_cast<int>(static_cast<std::int64_t>(k) & 3)};
}

}  // namespace

double det_sin(double x) {
  if (!(std::fabs(x) <= 1e6)) return nan_value;
  const Reduced r = reduce_to_quadrant(x);
  const double value = r.quadrant & 1 ? cos_small(r.remainder) : sin_small(r.remainder);
  return r.quadrant & 2 ? -value : value;
}

double det_cos(double x) {
  if (!(std::fabs(x) <= 1e6)) return nan_value;
  const Reduced r = reduce_to_quadrant(x);
  const double value = r.quadrant & 1 ? sin_small(r.remainder) : cos_small(r.remainder);
  return r.quadrant == 1 || r.quadrant == 2 ? -value : value;
}

double det_exp(double x) {
  if (x != x) return x;
  if (x > 709.78) return std::numeric_limits<double>::infinity();
  if (x < -745.0) return 0.0;
  // x = k ln 2 + r, |r| <= ln(2)/2
  const double k = std::floor(x * 1.44269504088896340736 + 0.5);
  const double r = (x - k * 0x1.62e42fefap-1) - k * 0x1.cf79abc9e3b3ap-40;
  double sum = 1.0 / 87178291200.0;
  for (double divisor : {6227020800.0, 479001600.0, 39916800.0, 3628800.0, 362880.0, 40320.0, 5040.0, 720.0,
                         120.0, 24.0, 6.0, 2.0}) {
    sum = sum * r + 1.0 / divisor;
  }
  const double value = 1.0 + (r + r * r * sum);
  // times 2^k in two halves, so that results near the ends of the range stay right
  const auto half = static_cast<std::int64_t>(k) / 2;
  const auto rest = static_cast<std::int64_t>(k) - half;
  const auto power = [](std::int64_t n) {
    return std::bit_cast<double>(static_cast<std::uint64_t>(n + 1023) << 52);
  };
  return value * power(half) * power(rest);
}

double det_atan2(double y, double x) {
  if (x != x || y != y) return nan_value;
  const double ay = std::fabs(y);
  const double ax = std::fabs(x);
  if (ay == 0.0 && ax == 0.0) return std::signbit(x) ? std::copysign(pi, y) : y;
  const bool swap = ay > ax;
  const double ratio = swap ? ax / ay : ay / ax;
  // halve the angle twice: tan(t/2) = tan t / (1 + sqrt(1 + tan^2 t))
  double t = ratio / (1.0 + std::sqrt(1.0 + ratio * ratio));
  t = t / (1.0 + std::sqrt(1.0 + t * t));
  const double t2 = t * t;
  double sum = 0.0;
  for (int n = 23; n >= 3; n -= 2) sum = t2 * ((n % 4 == 3 ? -1.0 : 1.0) / n + sum);
  double angle = 4.0 * (t + t * sum);
  if (swap) angle = 0.5 * pi - angle;
  if (std::signbit(x)) angle = pi - angle;
  return std::copysign(angle, y);
}

}  // namespace sulcus
