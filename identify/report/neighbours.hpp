#pragma once
#include <filesystem>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace isorig::identify::report {

/// Pages of other commands that belong with a page: text, and path relative to the page's folder.
using Links = std::vector<std::pair<std::string, std::string>>;

/// Those that are there now:
/// - in the page's folder, in folders in it, and in the folder that it stands in;
/// - in the other folders there, where that is a run's folder or holds one of the `inputs` (out/recordings/rep-1,
///   out/fv, out/diagnosis). Else whatever happens to lie in a common folder would be linked;
/// - the page of the run in whose folder the page or an input lies, or of which an input says that it was exported.
/// `inputs`: what a page was made from; what is no path is passed over. At most a dozen.
[[nodiscard]] Links neighbours(const std::filesystem::path& folder, std::string_view file_name,
                               const std::vector<std::string>& inputs);

/// A path as a link: '#', '?', '%' and spaces of a folder's name mean something else in one.
[[nodiscard]] std::string as_link(const std::string& path);

/// Another command calls its own page so: a page of `own_name` is not to be written over it.
[[nodiscard]] bool is_page_of_another(std::string_view file_name, std::string_view own_name);

/// A run that a recording was exported of, as its recording.toml says: it may have been moved since.
struct RunOf {
  std::string id;
  std::filesystem::path folder;  ///< empty: it does not say, as of an older isorig
};
/// Of those among `inputs` that are recordings, each run once; at most a dozen.
[[nodiscard]] std::vector<RunOf> runs_of(const std::vector<std::string>& inputs);

/// The folder of the run that `inside` lies in, or is; empty without one.
[[nodiscard]] std::filesystem::path run_folder_above(const std::filesystem::path& inside);

}  // namespace isorig::identify::report
