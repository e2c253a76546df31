#pragma once
#include <optional>
#include <string>
#include <string_view>
#include <vector>

/// Values in a protocol: a number, or text that multiplies and divides numbers and bound variables from left
/// to right ("direction * stroke_mm", "-stroke_mm / 2"). No sums, no functions: a protocol stays readable as
/// data.
namespace isorig::protocol {

struct Binding {
  std::string name;
  double value = 0.0;
};
using Bindings = std::vector<Binding>;

[[nodiscard]] const Binding* find(const Bindings& bindings, std::string_view name) noexcept;

/// A name that a protocol may bind: letters, digits, underscore; not beginning with a digit.
[[nodiscard]] bool is_name(std::string_view text) noexcept;

class Expression {
 public:
  Expression() = default;
  explicit Expression(double value) : constant_(value) {}

  /// Nothing when `text` is not an expression; `error` then says why.
  [[nodiscard]] static std::optional<Expression> parse(std::string_view text, std::string& error);

  /// All variables must be bound.
  [[nodiscard]] double value(const Bindings& bindings) const;
  /// In order of mention, each once.
  [[nodiscard]] std::vector<std::string> variables() const;

 private:
  struct Factor {
    std::string variable;  // empty: the number
    double number = 1.0;
    bool divides = false;
  };
  double constant_ = 1.0;
  std::vector<Factor> factors_;
};

/// Replaces every {name} by its value. Nothing when a name is not bound or a brace is left open.
[[nodiscard]] std::optional<std::string> fill_in(std::string_view text, const Bindings& bindings, std::string& error);

/// Shortest usual form: 0.05, 12, 1e-05.
[[nodiscard]] std::string number_text(double value);

}  // namespace isorig::protocol
