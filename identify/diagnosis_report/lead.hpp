#pragma once
#include <string>

#include "identify/diagnose/study.hpp"

namespace isorig::identify {

/// What a verdict of missing or unknown physics says at the top of its page. Only names that are likelier than not are
/// said to be lacking; the others are said with their probability. `where` says where model and muscle part.
[[nodiscard]] std::string lead_text(const Diagnosis& d, const std::string& where);

}  // namespace isorig::identify
