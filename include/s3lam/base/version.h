#pragma once

namespace s3lam {

/// The project's version, e.g. "0.1.0".
const char* Version();

}  // namespace s3lam
