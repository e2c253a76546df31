#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

/// What a request says about itself: where it thinks it is, from which page it comes, whose it is.
namespace isorig::web {

/// A name of this machine's own loopback, with any port: `localhost:8730`, `127.0.0.1`, `[::1]:9000`. Behind `ssh -L`
/// the port is another one. A name that somebody else's DNS leads here (rebinding) is none.
[[nodiscard]] bool is_loopback_host(std::string_view host);
/// The page that asks is this server's own: `http://` and the very host that the request was sent to. Browsers send an
/// origin with every POST and every WebSocket; a request without one is no browser's page.
[[nodiscard]] bool is_own_origin(std::string_view origin, std::string_view host);

/// A browser says by itself where an address was opened from (Sec-Fetch-Site): typed, or handed over by another program
/// (`none`), or a link of this very page. An empty `site` is of what is no browser, or of one from before 2023.
[[nodiscard]] bool is_opened_by_its_user(std::string_view site);

/// The value of a cookie in a Cookie header; empty when there is none.
[[nodiscard]] std::string cookie(std::string_view header, std::string_view name);

/// The value of `key` in the query of a target, for the numbers and hexadecimal digits used here; nothing is decoded.
[[nodiscard]] std::string query_value(std::string_view target, std::string_view key);
/// Such as `isorig web` puts into a link: 64 hexadecimal digits.
[[nodiscard]] bool is_token(std::string_view text);
/// A whole number, or nothing.
[[nodiscard]] std::optional<std::int64_t> whole_number(std::string_view text);

/// The path of a file as it stands in an address: it goes on to the daemon as it is, which judges where it leads. From
/// the root, percent-coded, without "//" and the parts "." and "..". Runs may lie below a hidden folder, as those of
/// ~/.local/share do: which one may be opened only the daemon knows.
[[nodiscard]] bool is_path_of_a_report(std::string_view path);

/// A file's name without any way to leave its folder: letters, digits, `-`, `_`, `.`, not first a dot, ends in `.toml`.
[[nodiscard]] bool is_plain_toml_name(std::string_view name);

}  // namespace isorig::web
