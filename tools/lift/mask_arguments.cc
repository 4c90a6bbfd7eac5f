#include "lift/mask_arguments.h"

#include <fmt/format.h>

#include <optional>
#include <string>

#include "common/config_files.h"
#include "common/program.h"
#include "s3lam/base/error.h"

namespace s3lam::tools {
namespace po = boost::program_options;

MaskFormat MaskFormatArgument(const po::variables_map& arguments) {
  const auto name = arguments["mask-format"].as<std::string>();
  const std::optional<MaskFormat> format = MaskFormatFromName(name);
  if (!format) throw UsageError(fmt::format("--mask-format {}: unknown format (see --help)", name));
  return *format;
}

PanopticMasks OpenMasks(const po::variables_map& arguments, const std::filesystem::path& directory,
                        MaskFormat format, const ClassTable& table) {
  const auto map_path = arguments["label-map"].as<std::string>();
  const LabelMap label_map =
      map_path.empty() ? LabelMap{} : ReadLabelMap(FindConfigFile(map_path, "label_maps"));
  const int divisor = arguments["label-divisor"].as<int>();
  if (divisor < 1) throw UsageError("--label-divisor must be positive");
  return {directory, format, arguments["mask-json"].as<std::string>(), table, label_map, divisor};
}

void AddMaskInputs(const po::variables_map& arguments, const PanopticMasks& masks,
                   Provenance& provenance) {
  provenance.AddListing("masks", Required(arguments, "masks"));
  provenance.AddFile("classes", FindConfigFile(Required(arguments, "classes"), "classes"));
  provenance.AddFile("label_map",
                     FindConfigFile(arguments["label-map"].as<std::string>(), "label_maps"));
  provenance.AddFile("mask_json", masks.json_path());
}

}  // namespace s3lam::tools
