#include "base/toml_budget.hpp"

#include <algorithm>

namespace isorig::base {
namespace {

class Scan {
 public:
  explicit Scan(std::string_view text) : text_(text) {}

  std::optional<OverBudget> run() {
    if (text_.size() > kMaxTomlBytes) {
      return OverBudget{
          0, 0, "more than " + std::to_string(kMaxTomlBytes >> 20U) + " MiB; no file that people write is as long"};
    }
    while (at_ < text_.size()) {
      const char c = text_[at_];
      if (c == '#') {
        at_ = std::min(text_.find('\n', at_), text_.size());
        continue;
      }
      if (c == '"' || c == '\'') {
        skip_string(c);
        continue;
      }
      if (c == '\n') {
        ++line_;
        line_begin_ = at_ + 1;
      }
      if (auto over = count(c)) return over;
      ++at_;
    }
    return std::nullopt;
  }

 private:
  std::optional<OverBudget> count(char c) {
    switch (c) {
      case '.':
        ++values_;
        if (++dots_ >= kMaxTomlDots) return at("a key of more than " + std::to_string(kMaxTomlDots) + " parts");
        break;
      case '[':
      case '{':
        dots_ = 0;
        ++values_;
        if (++brackets_ > kMaxTomlBrackets) {
          return at("more than " + std::to_string(kMaxTomlBrackets) + " brackets in each other; nest less deeply");
        }
        break;
      case ']':
      case '}':
        dots_ = 0;
        if (brackets_ > 0) --brackets_;
        break;
      case '=':
      case ',':
        ++values_;
        [[fallthrough]];
      case '\n':
        dots_ = 0;
        break;
      default:
        break;
    }
    if (values_ <= kMaxTomlValues) return std::nullopt;
    return at("more than " + std::to_string(kMaxTomlValues) + " values up to here; shorten the lists");
  }

  [[nodiscard]] OverBudget at(std::string message) const {
    return {line_, static_cast<std::uint32_t>(at_ - line_begin_ + 1), std::move(message)};
  }

  /// To behind its closing quote, or, where it has none, to the end of the line (of the text, for one of many lines).
  void skip_string(char quote) {
    const bool many = text_.substr(at_, 3) == std::string_view(quote == '"' ? "\"\"\"" : "'''");
    at_ += many ? 3 : 1;
    for (; at_ < text_.size(); ++at_) {
      const char c = text_[at_];
      if (c == '\n') {
        if (!many) return;
        ++line_;
        line_begin_ = at_ + 1;
      } else if (c == '\\' && quote == '"') {
        if (at_ + 1 < text_.size() && text_[at_ + 1] != '\n') ++at_;
      } else if (c == quote) {
        if (!many ||
            (text_.substr(at_, 3) == std::string(3, quote) && text_.substr(at_ + 3, 1) != std::string(1, quote))) {
          at_ += many ? 3 : 1;
          return;
        }
      }
    }
  }

  std::string_view text_;
  std::size_t at_ = 0, line_begin_ = 0;
  std::uint32_t line_ = 1, values_ = 0, brackets_ = 0, dots_ = 0;
};

}  // namespace

std::optional<OverBudget> over_budget(std::string_view text) {
  return Scan(text).run();
}

}  // namespace isorig::base
