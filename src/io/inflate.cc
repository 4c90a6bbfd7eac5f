#include "inflate.h"

#include <libdeflate.h>

#include <memory>
#include <new>

namespace s3lam {

std::optional<std::string> Inflate(std::string_view packed, size_t size, Wrapping wrapping) {
  constexpr size_t kMaxInflation = 1032;  // Of deflate.
  if (size / kMaxInflation > packed.size()) return std::nullopt;
  const std::unique_ptr<libdeflate_decompressor, decltype(&libdeflate_free_decompressor)>
      decompressor(libdeflate_alloc_decompressor(), &libdeflate_free_decompressor);
  if (!decompressor) throw std::bad_alloc();
  const auto decompress =
      wrapping == Wrapping::kZlib ? libdeflate_zlib_decompress : libdeflate_deflate_decompress;
  std::string content(size, '\0');
  const libdeflate_result result = decompress(decompressor.get(), packed.data(), packed.size(),
                                              content.data(), content.size(), nullptr);
  if (result != LIBDEFLATE_SUCCESS) return std::nullopt;
  return content;
}

}  // namespace s3lam
