#pragma once
#include <string_view>

/// The page, bundled at build time (web/build.mjs).
namespace isorig::web {

extern const std::string_view kPageHtml;
extern const std::string_view kPageScript;
extern const std::string_view kPageStyle;

}  // namespace isorig::web
