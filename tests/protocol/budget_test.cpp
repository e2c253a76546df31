#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmath>
#include <functional>
#include <random>

#include "protocol/compile.hpp"

/// Protocols that ask for too much: by a slip, by damage, or on purpose. The daemon compiles what its clients post,
/// with its memory locked.
namespace isorig::protocol {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr const char* kHead = "format = \"isorig-protocol/1\"\nname = \"p\"\n";
constexpr std::size_t kLargest = std::size_t{4} << 20U;

std::string outcome_of(const std::string& text) {
  try {
    (void)compile(base::TomlDocument::parse_text(text, "p.toml"));
    return "compiled";
  } catch (const base::ConfigError& e) {
    return e.what();
  }
}

struct Cost {
  bool ended = false;  ///< by itself, whatever it found
  double cpu_s = 0.0;
  double peak_MB = 0.0;  ///< beyond that of a process which does nothing
};

/// In a process of its own: what it costs is its alone, and a crash too.
template <class Work>
Cost cost_of(Work&& work) {
  const pid_t child = fork();
  if (child == 0) {
    const rlimit cpu{20, 20};
    setrlimit(RLIMIT_CPU, &cpu);
    work();
    _exit(0);
  }
  int status = 0;
  rusage used{};
  if (child < 0 || wait4(child, &status, 0, &used) != child) return {};
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return {WIFEXITED(status) && WEXITSTATUS(status) == 0, seconds(used.ru_utime) + seconds(used.ru_stime),
          static_cast<double>(used.ru_maxrss) / 1e3};
}

void expect_cheap(const std::string& name, const std::string& text) {
  SCOPED_TRACE(name);
  ASSERT_LE(text.size(), kLargest);
  const Cost cost = cost_of([&] { (void)outcome_of(text); });
  EXPECT_TRUE(cost.ended) << "crashed, or took more than 20 s of a processor";
#ifdef __SANITIZE_ADDRESS__
  EXPECT_LT(cost.cpu_s, 15.0);  // and no statement on memory: it quarantines what is freed
#else
  EXPECT_LT(cost.cpu_s, 1.0);
  // Forked after the text is made: both hold it.
  EXPECT_LT(cost.peak_MB - cost_of([] {}).peak_MB, 100.0);
#endif
}

std::string nested(int depth, const std::string& opening, const std::string& inner, const std::string& closing) {
  std::string text = "steps = [";
  for (int i = 0; i < depth; ++i) text += opening;
  text += inner;
  for (int i = 0; i < depth; ++i) text += closing;
  return text + "]\n";
}

std::string many(std::size_t bytes, const std::function<std::string(std::size_t)>& piece) {
  std::string text;
  for (std::size_t i = 0;; ++i) {
    const auto next = piece(i);
    if (text.size() + next.size() > bytes) return text;
    text += next;
  }
}

TEST(Budget, TurnsRoundNothingAreCounted) {
  const auto text = kHead + nested(3, "{ do = \"repeat\", times = 1e5, steps = [", "", "] }");
  EXPECT_THAT(outcome_of(text), HasSubstr("`times` is a float; a whole number is needed"));
  const auto whole = kHead + nested(3, "{ do = \"repeat\", times = 100000, steps = [", "", "] }");
  EXPECT_THAT(outcome_of(whole),
              AllOf(HasSubstr("p.toml:3:"), HasSubstr("turns 100000 times"), HasSubstr("1.00001e+10 turns"),
                    HasSubstr("more than 200000 turns are not taken")));
  expect_cheap("nested", whole);
}

TEST(Budget, ListsAreCountedBeforeTheyAreMultiplied) {
  std::string list = "[";
  for (int i = 1; i <= 600; ++i) list += std::to_string(i) + ",";
  list += "]";
  const auto text = kHead + ("steps = [\n{ do = \"repeat\", for = { a = " + list + ", b = " + list + ", c = " + list +
                             " }, steps = [ { do = \"hold\", duration_s = 1 } ] } ]\n");
  EXPECT_THAT(outcome_of(text),
              AllOf(HasSubstr("p.toml:4:"), HasSubstr("216000000 steps"), HasSubstr("more than 100000 steps")));
  expect_cheap("600^3", text);
}

TEST(Budget, OnlyTheSumIsTooMuch) {
  std::string steps;
  for (int i = 0; i < 3; ++i)
    steps += "{ do = \"repeat\", times = 50000, steps = [ { do = \"hold\", duration_s = 1 } ] },\n";
  EXPECT_THAT(outcome_of(kHead + ("steps = [\n" + steps + "]\n")),
              AllOf(HasSubstr("p.toml:3:"), HasSubstr("all repeats together come to 150000 steps")));
}

TEST(Budget, TheLargestThatIsTaken) {
  const std::string text =
      kHead +
      std::string(
          "steps = [ { do = \"pressurize\", pressure_psi = 5, rate_psi_s = 1, settled_for_s = 1, timeout_s = 60 },\n"
          "{ do = \"repeat\", times = 99999, steps = [ { do = \"hold\", duration_s = 1 } ] } ]\n");
  EXPECT_EQ(outcome_of(text), "compiled");
  expect_cheap("100000 steps", text);
  const std::string sessions =
      kHead +
      std::string(
          "steps = [ { do = \"repeat\", unit = \"session\", times = 100000, steps = [\n"
          "{ do = \"pressurize\", pressure_psi = 5, rate_psi_s = 1, settled_for_s = 1, timeout_s = 60 } ] } ]\n");
  expect_cheap("100000 sessions", sessions);
}

TEST(Budget, DepthIsBounded) {
  EXPECT_THAT(outcome_of(kHead + nested(100, "{ do = \"repeat\", times = 1, steps = [", "", "] }")),
              HasSubstr("brackets in each other"));
  std::string dotted = "a";
  while (dotted.size() < kLargest - 100) dotted += ".a";
  EXPECT_THAT(outcome_of(dotted + " = 1\n"), HasSubstr("p.toml:1:64: a key of more than 32 parts"));
  EXPECT_THAT(outcome_of("[" + dotted + "]\n"), HasSubstr("a key of more than 32 parts"));
  EXPECT_THAT(outcome_of(std::string(kLargest + 1, '#')), HasSubstr("more than 4 MiB"));
}

TEST(Budget, WhatIsInStringsAndCommentsIsNotCounted) {
  std::string text = "# " + std::string(1000, '[') + std::string(1000, '.') + "\n" + kHead;
  text += "description = \"\"\"" + std::string(100, '{') + "\n\\\"\"\" , . , \"\"\"\nconstants.x = 1.5\n";
  text +=
      "steps = [ { do = \"hold\", 'duration_s' = 1 }, { do = \"mark\", label = '" + std::string(40, '.') + "' } ]\n";
  EXPECT_THAT(outcome_of(text), HasSubstr("a session begins with a pressurize"));  // it came as far as the values
}

TEST(Budget, GeneratedNasties) {
  const std::size_t big = kLargest - 1000;
  const std::vector<std::pair<std::string, std::string>> nasties = {
      {"brackets", "steps = " + std::string(big, '[')},
      {"braces", "steps = " + many(big, [](std::size_t) { return "{a="; })},
      {"headers", kHead + many(big, [](std::size_t) { return "[[steps]]\n"; })},
      {"empty repeats",
       kHead + ("steps = [" + many(big, [](std::size_t) { return "{do=\"repeat\",times=1,steps=[]},"; }) + "]\n")},
      {"flat steps",
       kHead + ("steps = [" + many(1'400'000, [](std::size_t) { return "{do=\"hold\",duration_s=1},"; }) + "]\n")},
      {"wrong steps",
       kHead + ("steps = [" +
                many(1'400'000, [](std::size_t i) { return "{do=\"hold\",duration_s=-" + std::to_string(i) + "},"; }) +
                "]\n")},
      {"unknown keys", kHead + many(big, [](std::size_t i) { return "k" + std::to_string(i) + "=1\n"; })},
      {"one long key", kHead + (std::string(big, 'k') + " = 1\n")},
      {"one long string", kHead + ("steps = [ { do = \"" + std::string(big, 'x') + "\" } ]\n")},
      {"long label", kHead + ("steps = [ { do = \"repeat\", times = 100000, steps = [ { do = \"mark\", label = \"" +
                              many(big, [](std::size_t) { return "{a}"; }) + "\" } ] } ]\n")},
      {"long expression", kHead + ("constants.a = 1\nsteps = [ { do = \"hold\", duration_s = \"a" +
                                   many(big, [](std::size_t) { return "*a"; }) + "\" } ]\n")},
      {"long list", kHead + ("steps = [ { do = \"repeat\", for = { a = [" +
                             many(big, [](std::size_t) { return "1,"; }) + "] }, steps = [] } ]\n")},
      {"constants",
       kHead + ("constants = {" + many(900'000, [](std::size_t i) { return "c" + std::to_string(i) + "=1,"; }) +
                "z=1}\nsteps = [" + many(900'000, [](std::size_t) { return "{do=\"hold\",duration_s=\"nobody\"},"; }) +
                "]\n")},
      {"unknown variables",
       kHead +
           ("steps = [" +
            many(1'400'000, [](std::size_t i) { return "{do=\"hold\",duration_s=\"v" + std::to_string(i) + "\"},"; }) +
            "]\n")},
      {"rows", kHead + ("steps = [ { do = \"repeat\", for = [" +
                        many(1'400'000, [](std::size_t i) { return "{a=1,b" + std::to_string(i) + "=2},"; }) +
                        "], steps = [] } ]\n")},
      {"many faults in turns",
       kHead + std::string("steps = [ { do = \"repeat\", times = 300, steps = [ { do = \"repeat\", for = { a = [") +
           many(1800, [](std::size_t i) { return std::to_string(i) + ","; }) +
           "] }, steps = [ { do = \"hold\", duration_s = \"-1 * a\" } ] } ] } ]\n"},
      {"blanks", kHead + std::string(big, ' ')},
      {"line ends", kHead + std::string(big, '\n')},
      {"zeros", std::string(big, '\0')},
  };
  for (const auto& [name, text] : nasties) expect_cheap(name, text);
}

/// Random trees of repeats: the count says what the walk would do, and the walk stays within it.
TEST(Budget, GeneratedTrees) {
  std::mt19937_64 random(7);
  const auto pick = [&](int low, int high) { return std::uniform_int_distribution<int>(low, high)(random); };
  std::function<std::string(int)> tree = [&](int depth) {
    std::string steps;
    for (int i = pick(0, 3); i > 0; --i) {
      if (depth == 0 || pick(0, 2) == 0) {
        steps += "{do=\"hold\",duration_s=1},";
      } else if (pick(0, 1) == 0) {
        steps += "{do=\"repeat\",times=" + std::to_string(static_cast<int>(std::pow(10, pick(0, 5)))) + ",steps=[" +
                 tree(depth - 1) + "]},";
      } else {
        steps += "{do=\"repeat\",for={v" + std::to_string(depth) + "=[" +
                 many(static_cast<std::size_t>(pick(2, 400)), [](std::size_t) { return "1,"; }) + "1]},steps=[" +
                 tree(depth - 1) + "]},";
      }
    }
    return steps;
  };
  for (int i = 0; i < 40; ++i) {
    const std::string text = kHead + ("steps = [" + tree(6) + "]\n");
    expect_cheap(text.substr(0, 300), text);
    if (HasFailure()) return;
  }
}

}  // namespace
}  // namespace isorig::protocol
