#include "s3lam/base/parallel.h"

#include <gtest/gtest.h>

#include <atomic>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

namespace s3lam {
namespace {

TEST(ParallelFor, VisitsEveryItemOnce) {
  for (const int threads : {0, 1, 2, 7}) {
    for (const size_t count : {size_t{0}, size_t{1}, size_t{5}, size_t{1000}}) {
      std::vector<int> visits(count, 0);
      ParallelFor(count, threads, [&](size_t i) { ++visits[i]; });
      EXPECT_EQ(visits, std::vector<int>(count, 1)) << threads << " threads, " << count;
    }
  }
}

TEST(ParallelFor, RethrowsAndStops) {
  for (const int threads : {1, 4}) {
    std::atomic<int> calls = 0;
    const auto body = [&](size_t i) {
      ++calls;
      if (i == 3) throw std::runtime_error("item 3");
    };
    EXPECT_THROW(
        {
          try {
            ParallelFor(1000000, threads, body);
          } catch (const std::runtime_error& error) {
            EXPECT_STREQ(error.what(), "item 3");
            throw;
          }
        },
        std::runtime_error);
    EXPECT_LT(calls, 1000000);
  }
}

TEST(ParallelFor, SurvivesExceptionsOnAllThreads) {
  EXPECT_THROW(ParallelFor(64, 4, [](size_t) { throw std::logic_error("each"); }),
               std::logic_error);
}

TEST(ParallelFor, RethrowsWhatASingleThreadWouldMeetFirst) {
  // Item 0 fails last: whatever the others report before must not win.
  std::atomic<int> failed = 0;
  const auto body = [&](size_t i) {
    while (i == 0 && failed == 0) std::this_thread::yield();
    ++failed;
    throw std::runtime_error(std::to_string(i));
  };
  try {
    ParallelFor(64, 4, body);
    FAIL() << "nothing thrown";
  } catch (const std::runtime_error& error) {
    EXPECT_STREQ(error.what(), "0");
  }
}

TEST(ResolveThreads, TakesWhatIsAskedOrAllThereAre) {
  EXPECT_EQ(ResolveThreads(3), 3);
  EXPECT_GE(ResolveThreads(0), 1);
}

}  // namespace
}  // namespace s3lam
