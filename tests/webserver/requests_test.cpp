#include "webserver/rules/requests.hpp"

#include <gtest/gtest.h>

namespace isorig::web {
namespace {

TEST(Requests, OnlyNamesOfTheLoopbackAreTaken) {
  for (const char* host : {"localhost", "localhost:8730", "127.0.0.1", "127.0.0.1:1", "[::1]", "[::1]:65535"}) {
    EXPECT_TRUE(is_loopback_host(host)) << host;
  }
  for (const char* host :
       {"", "localhost.evil.example", "localhost:", "localhost:x", "localhost:123456", "evil.example:8730",
        "127.0.0.1.evil.example", "127.0.0.12", "localhost@evil.example", "[::1].example"}) {
    EXPECT_FALSE(is_loopback_host(host)) << host;
  }
}

TEST(Requests, AnOriginIsOwnOnlyAsAWhole) {
  EXPECT_TRUE(is_own_origin("http://localhost:8730", "localhost:8730"));
  for (const char* origin : {"", "null", "http://localhost:8731", "https://localhost:8730", "http://127.0.0.1:8730",
                             "http://localhost:8730.evil.example", "http://evil.example"}) {
    EXPECT_FALSE(is_own_origin(origin, "localhost:8730")) << origin;
  }
  EXPECT_FALSE(is_own_origin("http://evil.example", "evil.example"));
}

TEST(Requests, AnotherSiteOpensNothingInItsUsersName) {
  for (const char* site : {"", "none", "same-origin"}) EXPECT_TRUE(is_opened_by_its_user(site)) << site;
  for (const char* site : {"cross-site", "same-site", "of a later browser"}) EXPECT_FALSE(is_opened_by_its_user(site));
}

TEST(Requests, CookiesAndQueries) {
  EXPECT_EQ(cookie("a=1; isorig-8730=abc;b=2", "isorig-8730"), "abc");
  EXPECT_EQ(cookie("xisorig-8730=abc", "isorig-8730"), "");
  EXPECT_EQ(cookie("isorig-8730", "isorig-8730"), "");
  EXPECT_EQ(cookie("", "a"), "");
  EXPECT_EQ(query_value("/enter?token=12ab", "token"), "12ab");
  EXPECT_EQ(query_value("/enter?x=1&token=12ab&y", "token"), "12ab");
  EXPECT_EQ(query_value("/enter?nottoken=12ab", "token"), "");
  EXPECT_EQ(query_value("/enter", "token"), "");
  EXPECT_TRUE(is_token(std::string(63, '0') + "f"));
  for (const auto& text : {std::string(), std::string(63, '0'), std::string(65, '0'), std::string(63, '0') + "\"",
                           std::string(63, '0') + "F"}) {
    EXPECT_FALSE(is_token(text)) << text;
  }
  EXPECT_EQ(whole_number("-12"), -12);
  for (const char* text : {"", "1.5", "1e3", "99999999999999999999", " 1"}) EXPECT_FALSE(whole_number(text)) << text;
}

TEST(Requests, AFilesNameCannotLeaveItsFolder) {
  EXPECT_TRUE(is_plain_toml_name("vma-smoke.toml"));
  for (const char* name : {"", ".toml", "../rig.toml", "a/b.toml", ".hidden.toml", "rig.toml\n", "rig", "a b.toml"}) {
    EXPECT_FALSE(is_plain_toml_name(name)) << name;
  }
  EXPECT_FALSE(is_plain_toml_name(std::string(200, 'a') + ".toml"));
}

TEST(Requests, APathOfAReportIsOneFromTheRootWithoutAWayUp) {
  EXPECT_TRUE(is_path_of_a_report("/var/lib/isorig/runs/20261123-x/report.html"));
  EXPECT_TRUE(is_path_of_a_report("/a%20b%23/fv-report.html"));
  EXPECT_TRUE(is_path_of_a_report("/home/ann/.local/share/isorig/runs/r/report.html")) << "the daemon judges the rest";
  EXPECT_TRUE(is_path_of_a_report("/a/..b/.report.html"));
  for (const char* path :
       {"", "report.html", "//evil.example/report.html", "/a//report.html", "/../report.html", "/a/./report.html",
        "/a/b/../report.html", "/a\\report.html", "/a?x=report.html", "/a&path=/b/report.html", "/a#report.html",
        "/a/report.html\r\nX: y", "/a/report.htm", "/a b/report.html", "/\xc3\xa4/report.html"}) {
    EXPECT_FALSE(is_path_of_a_report(path)) << path;
  }
  EXPECT_FALSE(is_path_of_a_report("/" + std::string(5000, 'a') + "/report.html"));
}

}  // namespace
}  // namespace isorig::web
