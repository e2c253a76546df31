// A file of another program: its encoding, its tables, what its columns mean, its numbers.
#include <set>

#include "messages/foreign/decoded_text.hpp"
#include "messages/foreign/samples.hpp"
#include "target.hpp"

namespace {

using namespace isorig;

/// As a person does who answers each question with the first thing that is taken: of an output, then of the load.
void answer_questions(const foreign::Table& table, foreign::Mapping& mapping) {
  for (int round = 0; round < 2; ++round) {
    const auto understood = foreign::understand(table, mapping);
    for (const auto& question : understood.questions) {
      fuzz::refused(question.text);
      fuzz::refused(question.answer);
      for (const char* answer : {"position", "pressure", "#1", "#2", "mm", "N", "s", "psi", "tension", "1"}) {
        if (question.take(answer, mapping)) break;
      }
    }
  }
}

/// What is written behind the columns of a recording has to be read as further columns again.
void require_kept(const foreign::Test& test, std::size_t rows) {
  std::set<std::string> names;
  for (const auto& kept : test.kept) {
    const auto& [name, cells] = kept.column;
    fuzz::require(!name.empty() && name.find_first_of(",\"\r\n \t") == std::string::npos,
                  "a further column without a name");
    fuzz::require(names.insert(name).second, "two further columns of one name");
    fuzz::require(cells.size() == rows, "a further column of another length");
    for (const auto& cell : cells) fuzz::require(cell.find(',') == std::string::npos, "a further cell with a comma");
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    const auto decoded = foreign::decode(fuzz::text({data, size}), "file.csv");
    const auto parsed = foreign::parse_tables(decoded.utf8, "file.csv", {});
    for (const auto& table : parsed.tables) {
      foreign::Mapping mapping;
      if (size % 4 < 3) mapping.output = static_cast<messages::Output>(size % 4);
      answer_questions(table, mapping);
      const auto understood = foreign::understand(table, mapping);
      if (!understood.refusal.empty() || !understood.questions.empty() || understood.sources.empty()) continue;
      try {
        const auto test = foreign::convert(table, understood.sources, parsed.decimal, 0.0, "file.csv",
                                           understood.loaded ? mapping.load_N : std::nullopt);
        require_kept(test, table.rows.size());
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
