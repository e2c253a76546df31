#include "protocol/expression.hpp"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>

#include "base/number_text.hpp"

namespace isorig::protocol {
namespace {
constexpr std::size_t kMaxFactors = 32;
}

const Binding* find(const Bindings& bindings, std::string_view name) noexcept {
  for (const auto& binding : bindings) {
    if (binding.name == name) return &binding;
  }
  return nullptr;
}

bool is_name(std::string_view text) noexcept {
  const auto letter = [](char c) { return std::isalpha(static_cast<unsigned char>(c)) != 0 || c == '_'; };
  const auto inner = [&](char c) { return letter(c) || std::isdigit(static_cast<unsigned char>(c)) != 0; };
  return !text.empty() && letter(text.front()) && std::all_of(text.begin(), text.end(), inner);
}

std::string number_text(double value) {
  return base::number_text(value, 10);
}

std::optional<Expression> Expression::parse(std::string_view text, std::string& error) {
  const auto skip_space = [&] {
    while (!text.empty() && std::isspace(static_cast<unsigned char>(text.front())) != 0) text.remove_prefix(1);
  };
  Expression out;
  skip_space();
  if (!text.empty() && text.front() == '-') {
    out.constant_ = -1.0;
    text.remove_prefix(1);
  }
  bool divides = false;
  while (true) {
    skip_space();
    const auto in_word = [](char c) {
      return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_' || c == '.';
    };
    std::size_t length = 0;
    while (length < text.size() && in_word(text[length])) {
      ++length;
      // The sign of an exponent belongs to the number: 1e-3.
      if (length < text.size() && (text[length] == '-' || text[length] == '+') &&
          (text[length - 1] == 'e' || text[length - 1] == 'E') &&
          std::isdigit(static_cast<unsigned char>(text.front())) != 0) {
        ++length;
      }
    }
    const auto word = text.substr(0, length);
    if (word.empty()) {
      error = text.empty() ? "a number or a variable is missing at its end"
                           : "a number or a variable is needed before `" + std::string(text) + "`";
      return std::nullopt;
    }
    if (out.factors_.size() >= kMaxFactors) {
      error = "more than " + std::to_string(kMaxFactors) + " factors; bind a part of it to a name";
      return std::nullopt;
    }
    Factor factor;
    factor.divides = divides;
    if (is_name(word)) {
      factor.variable = std::string(word);
    } else {
      const auto [end, code] = std::from_chars(word.data(), word.data() + word.size(), factor.number);
      if (code != std::errc{} || end != word.data() + word.size()) {
        error = "`" + std::string(word) + "` is neither a number nor a variable";
        return std::nullopt;
      }
    }
    out.factors_.push_back(std::move(factor));
    text.remove_prefix(length);
    skip_space();
    if (text.empty()) return out;
    if (text.front() != '*' && text.front() != '/') {
      error = "only * and / may follow a value, not `" + std::string(text) + "`";
      return std::nullopt;
    }
    divides = text.front() == '/';
    text.remove_prefix(1);
  }
}

double Expression::value(const Bindings& bindings) const {
  double out = constant_;
  for (const auto& factor : factors_) {
    const Binding* bound = factor.variable.empty() ? nullptr : find(bindings, factor.variable);
    const double value = bound != nullptr ? bound->value : factor.number;
    out = factor.divides ? out / value : out * value;
  }
  return out == 0.0 ? 0.0 : out;  // -0 would print as such
}

std::vector<std::string> Expression::variables() const {
  std::vector<std::string> out;
  for (const auto& factor : factors_) {
    if (!factor.variable.empty() && std::find(out.begin(), out.end(), factor.variable) == out.end()) {
      out.push_back(factor.variable);
    }
  }
  return out;
}

std::optional<std::string> fill_in(std::string_view text, const Bindings& bindings, std::string& error) {
  std::string out;
  while (!text.empty()) {
    const auto open = text.find('{');
    out += text.substr(0, open);
    if (open == std::string_view::npos) break;
    const auto close = text.find('}', open);
    if (close == std::string_view::npos) {
      error = "`{` is never closed";
      return std::nullopt;
    }
    const auto name = text.substr(open + 1, close - open - 1);
    const Binding* bound = find(bindings, name);
    if (bound == nullptr) {
      error = "{" + std::string(name) + "} is not a variable that is bound here";
      return std::nullopt;
    }
    out += number_text(bound->value);
    text.remove_prefix(close + 1);
  }
  return out;
}

}  // namespace isorig::protocol
