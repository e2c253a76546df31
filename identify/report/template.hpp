#pragma once
#include <string_view>

namespace isorig::identify::report {

/// The page that every report is, in three pieces: title and data stand between them. Bundled from web/
/// (web/build.mjs).
extern const std::string_view kTemplateHead;
extern const std::string_view kTemplateBody;
extern const std::string_view kTemplateTail;

}  // namespace isorig::identify::report
