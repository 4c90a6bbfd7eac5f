#include "s3lam/base/natural_order.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace s3lam {
namespace {

TEST(NaturalOrder, OfNames) {
  const std::vector<std::string> ordered = {
      "",         "cam0/frame10.png", "cam0-b/1.png", "cam1/1.png", "frame",    "frame-1.png",
      "frame009", "frame9",           "frame9.png",   "frame10",    "frame10b", "\xc3\xa9.png"};
  for (size_t i = 0; i < ordered.size(); ++i) {
    for (size_t j = 0; j < ordered.size(); ++j) {
      EXPECT_EQ(NaturalLess(ordered[i], ordered[j]), i < j) << ordered[i] << " " << ordered[j];
    }
  }
}

TEST(NaturalOrder, OfNumbersLongerThanAnyInteger) {
  const std::string digits(40, '7');
  EXPECT_TRUE(NaturalLess(digits, digits + "0"));
  EXPECT_TRUE(NaturalLess("000" + digits, digits));
  EXPECT_FALSE(NaturalLess(digits, "000" + digits));
}

}  // namespace
}  // namespace s3lam
