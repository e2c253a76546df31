// A file of another program: its encoding, its tables, what its columns mean, its numbers.
#include "messages/foreign/decoded_text.hpp"
#include "messages/foreign/samples.hpp"
#include "target.hpp"

namespace {

using namespace isorig;

/// As a person does who answers each question with the first thing that is taken.
void answer_questions(const foreign::Table& table, foreign::Mapping& mapping) {
  const auto understood = foreign::understand(table, mapping);
  for (const auto& question : understood.questions) {
    fuzz::refused(question.text);
    for (const char* answer : {"#1", "#2", "mm", "N", "s", "psi", "tension", "1"}) {
      if (question.take(answer, mapping)) break;
    }
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    const auto decoded = foreign::decode(fuzz::text({data, size}), "file.csv");
    const auto parsed = foreign::parse_tables(decoded.utf8, "file.csv", {});
    for (const auto& table : parsed.tables) {
      foreign::Mapping mapping;
      answer_questions(table, mapping);
      const auto understood = foreign::understand(table, mapping);
      if (!understood.refusal.empty() || !understood.questions.empty() || understood.sources.empty()) continue;
      try {
        const auto test = foreign::convert(table, understood.sources, parsed.decimal, 0.0, "file.csv");
        if (test.frame) fuzz::require(test.frame->t_s.size() == test.frame->force_N.size(), "columns of two lengths");
      } catch (const messages::RecordingError& error) {
        fuzz::refused(error.what());
      }
    }
  } catch (const messages::RecordingError& error) {
    fuzz::refused(error.what());
  }
  return 0;
}
