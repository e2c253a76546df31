#pragma once
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "base/toml_reader.hpp"
#include "protocol/expression.hpp"
#include "protocol/plan.hpp"

/// The protocol's text as a tree, before `repeat` is expanded. Everything that is wrong whatever the
/// variables' values (unknown keys, types, expressions, names) is noted here, once; compile.cpp looks at
/// values.
namespace isorig::protocol::syntax {

struct Node {
  explicit Node(const base::TomlTable& source) : table(source) {}

  base::TomlTable table;
  bool is_repeat = false;

  // A step.
  StepKind kind = StepKind::kMark;
  /// Absent: the key was not given, or was wrong and has been reported.
  std::map<std::string, Expression, std::less<>> values;
  std::set<std::string, std::less<>> broken;  ///< given and wrong, or required and missing
  std::string label;                          ///< of a mark, or of a session
  std::optional<Keep> record;
  OnTimeout on_timeout = OnTimeout::kStop;
  WaveShape shape = WaveShape::kTriangle;

  // A repeat: the body once per turn.
  bool is_session = false;
  struct List {
    std::string name;
    std::vector<double> values;
  };
  std::vector<List> lists;     ///< every combination is a turn; the first varies slowest
  std::vector<Bindings> rows;  ///< or each of these
  double times = 1.0;          ///< or so many that bind nothing
  std::vector<Node> body;

  /// A double: lists multiply beyond any whole number.
  [[nodiscard]] double turns() const;
  /// What turn `index` < turns() binds.
  [[nodiscard]] Bindings bindings_of(std::size_t index) const;
};

struct Protocol {
  std::string name;
  std::string description;
  RecordingPolicy recording;
  TwinWish twin;
  bool approaches = true;
  double approach_velocity_mm_s = 1.0;
  Bindings constants;
  std::vector<Node> steps;
};

/// Notes what is wrong in `root`'s document.
[[nodiscard]] Protocol parse(const base::TomlTable& root);

}  // namespace isorig::protocol::syntax
