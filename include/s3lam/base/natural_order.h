#pragma once

#include <string>

namespace s3lam {

/// Natural order of names ("frame9" before "frame10"): a strict weak order that compares runs of
/// digits by value, and has folders before the files beside them.
bool NaturalLess(const std::string& a, const std::string& b);

}  // namespace s3lam
