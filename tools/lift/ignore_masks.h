#pragma once

#include <boost/program_options.hpp>

#include "common/program.h"

namespace s3lam::tools {

/// s3-lift --sequence: writes for every frame of a sequence that has a mask what to ignore in it.
void WriteIgnoreMasks(const boost::program_options::variables_map& arguments,
                      const CommonArguments& common);

}  // namespace s3lam::tools
