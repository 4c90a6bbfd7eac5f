#pragma once

#include <boost/program_options.hpp>
#include <filesystem>

#include "common/provenance.h"
#include "s3lam/io/panoptic_masks.h"

namespace s3lam::tools {

/// As --mask-format says; throws UsageError for a name that is none.
MaskFormat MaskFormatArgument(const boost::program_options::variables_map& arguments);

/// With --mask-json, --label-map and --label-divisor.
PanopticMasks OpenMasks(const boost::program_options::variables_map& arguments,
                        const std::filesystem::path& directory, MaskFormat format,
                        const ClassTable& table);

/// Adds the masks, and what says what they mean, to the inputs of a result.
void AddMaskInputs(const boost::program_options::variables_map& arguments,
                   const PanopticMasks& masks, Provenance& provenance);

}  // namespace s3lam::tools
