# For the project of the messages: all that is generated for one library is compiled as one source,
# since nearly all the time goes into headers, which are the same for every message. Left out are
# the libraries in C whose sources use one name for different things.
function(unite)
  get_property(targets DIRECTORY PROPERTY BUILDSYSTEM_TARGETS)
  list(FILTER targets INCLUDE REGEX "__rosidl_(typesupport_.*|generator_py)$")
  list(FILTER targets EXCLUDE REGEX "_introspection_c$")
  foreach(target IN LISTS targets)
    set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 0)
  endforeach()
endfunction()
cmake_language(DEFER CALL unite)
