// Elementary functions made of + - * / and sqrt only. They exist because libm gives different bits on
// different processors and versions (docs/determinism.md); these give the same everywhere.
#pragma once

namespace sulcus {

// Largest error 2 ulp (atan2 4 ulp) against libm, tested. |x| <= 1e6 for sin and cos (NaN beyond).
double det_sin(double x);
double det_cos(double x);
double det_exp(double x);  // 0 below -745, +inf above 709.8
double det_atan2(double y, double x);

}  // namespace sulcus
