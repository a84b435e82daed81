#include "core/result/notice.hpp"

#include <gtest/gtest.h>

#include <set>

namespace bromwich {
namespace {

constexpr NoticeCode first = NoticeCode::error_of_steps, last = NoticeCode::too_many_steps;

TEST(Notices, EachCodeHasASentenceOfItsOwn) {
  std::set<std::string> seen;
  for (int code = int(first); code <= int(last); ++code) {
    const std::string words = sentence({.code = NoticeCode(code), .size = 0.25, .other = 0.5, .t = 3, .count = 7});
    EXPECT_FALSE(words.empty()) << code;
    EXPECT_TRUE(seen.insert(words).second) << words;
    EXPECT_EQ(words.find('\n'), std::string::npos) << words;
    EXPECT_EQ(words.find("nan"), std::string::npos) << words;
  }
}

TEST(Notices, NumbersAreInTheSentence) {
  const std::string of_steps =
      sentence({.code = NoticeCode::error_of_steps, .size = 0.25, .other = 0.054, .of_mean = true});
  EXPECT_NE(of_steps.find("x by about 25 %, the mean of y by about 5.4 %"), std::string::npos) << of_steps;
  const std::string at = sentence({.code = NoticeCode::other_state, .t = 0.125});
  EXPECT_NE(at.find("t = 0.125"), std::string::npos) << at;
}

TEST(Notices, UnknownNumbersAreLeftOut) {
  for (int code = int(first); code <= int(last); ++code) {
    const NoticeCode c = NoticeCode(code);
    if (c == NoticeCode::other_y || c == NoticeCode::other_state) continue;  // they always have a time
    EXPECT_EQ(sentence({c}).find("t = nan"), std::string::npos) << sentence({c});
  }
}

TEST(Notices, TheSameIsToldOnce) {
  Result r;
  tell(r, {NoticeCode::first_order});
  tell(r, {NoticeCode::undivided_jumps});
  tell(r, {NoticeCode::first_order});
  EXPECT_EQ(r.warning, sentence({NoticeCode::first_order}) + "; " + sentence({NoticeCode::undivided_jumps}));
}

}  // namespace
}  // namespace bromwich
