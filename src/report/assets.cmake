# Writes a C++ source that holds the bytes of files.
#
#   cmake -DOUTPUT=assets.cc -DFILES=kName=path;kOther=path -P assets.cmake
file(WRITE ${OUTPUT}.tmp "#include \"${CMAKE_CURRENT_LIST_DIR}/assets.h\"\n\n")
file(APPEND ${OUTPUT}.tmp "namespace s3lam::report::assets {\nnamespace {\n")
set(views "")
foreach(entry IN LISTS FILES)
  string(REPLACE "=" ";" entry "${entry}")
  list(GET entry 0 name)
  list(GET entry 1 path)
  file(READ ${path} bytes HEX)
  string(REGEX REPLACE "(..)" "0x\\1," bytes "${bytes}")
  file(APPEND ${OUTPUT}.tmp "constexpr unsigned char ${name}Bytes[] = {${bytes}};\n")
  string(APPEND views "extern const std::string_view ${name};\n"
    "const std::string_view ${name}(reinterpret_cast<const char*>(${name}Bytes), sizeof(${name}Bytes));\n")
endforeach()
file(APPEND ${OUTPUT}.tmp "}  // namespace\n\n${views}\n}  // namespace s3lam::report::assets\n")
file(RENAME ${OUTPUT}.tmp ${OUTPUT})
