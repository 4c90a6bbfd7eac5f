#include "s3lam/report/html_text.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace s3lam {
namespace {

TEST(HtmlText, MarkupIsEscaped) {
  EXPECT_EQ(EscapeHtml("</script><b a='1' b=\"2\">&"),
            "&lt;/script&gt;&lt;b a=&#39;1&#39; b=&quot;2&quot;&gt;&amp;");
}

TEST(HtmlText, ValidUtf8IsKept) {
  for (const char* text : {"", "abc\n\t", "\xC3\xA9", "\xE2\x82\xAC", "\xF0\x9F\x98\x80",
                           "\xEF\xBF\xBD", "\xF4\x8F\xBF\xBF"}) {
    EXPECT_EQ(ValidUtf8(text), text);
  }
}

TEST(HtmlText, InvalidBytesAreReplaced) {
  const std::string mark = "\xEF\xBF\xBD";
  EXPECT_EQ(ValidUtf8("a\xFF"
                      "b"),
            "a" + mark + "b");
  EXPECT_EQ(ValidUtf8("\xC3"), mark);             // Cut short.
  EXPECT_EQ(ValidUtf8("\x80"), mark);             // Continuation without a lead.
  EXPECT_EQ(ValidUtf8("\xC0\xAF"), mark + mark);  // Overlong.
  EXPECT_EQ(ValidUtf8("\xE0\x80\x80"), mark + mark + mark);
  EXPECT_EQ(ValidUtf8("\xED\xA0\x80"), mark + mark + mark);             // Surrogate.
  EXPECT_EQ(ValidUtf8("\xF4\x90\x80\x80"), mark + mark + mark + mark);  // Beyond U+10FFFF.
  EXPECT_EQ(ValidUtf8(std::string_view("\0\x1b", 2)), mark + mark);
}

TEST(HtmlText, JsonCannotEndItsScript) {
  const nlohmann::json json = {{"name", "</script><!-- \xFF"}, {"x", 1.5}};
  const std::string text = JsonForScript(json);
  EXPECT_EQ(text.find('<'), std::string::npos);
  const nlohmann::json back = nlohmann::json::parse(text);
  EXPECT_EQ(back["name"], "</script><!-- \xEF\xBF\xBD");
  EXPECT_EQ(back["x"], 1.5);
}

// RFC 4648, section 10.
TEST(HtmlText, Base64) {
  EXPECT_EQ(Base64(""), "");
  EXPECT_EQ(Base64("f"), "Zg==");
  EXPECT_EQ(Base64("fo"), "Zm8=");
  EXPECT_EQ(Base64("foo"), "Zm9v");
  EXPECT_EQ(Base64("foobar"), "Zm9vYmFy");
  EXPECT_EQ(Base64("\xFF\xFE\xFD"), "//79");
}

TEST(HtmlText, Base64OfNumbers) {
  const float values[] = {1.0F, -2.0F};
  EXPECT_EQ(Base64OfArray(std::span<const float>(values)), "AACAPwAAAMA=");
}

}  // namespace
}  // namespace s3lam
