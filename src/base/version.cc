#include "s3lam/base/version.h"

namespace s3lam {

const char* Version() { return S3LAM_VERSION; }

}  // namespace s3lam
