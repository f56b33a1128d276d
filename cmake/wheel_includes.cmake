# Passed as CMAKE_PROJECT_INCLUDE when interface packages are built against the ROS 2 wheels; a ROS 2 installation needs
# none of it, and no installed file is changed.
#
# In an environment of wheels all nodes are Python: what serves C++ nodes is not generated, which saves nearly half of
# the time.
find_package(ament_cmake REQUIRED)
find_package(rosidl_default_generators REQUIRED)
list(FILTER AMENT_EXTENSIONS_rosidl_generate_idl_interfaces EXCLUDE REGEX "_cpp:")

# The wheels' exported targets name include folders of the machine that built the wheels, and CMake stops at a path that
# does not exist: they are dropped. The generated C++ sources of several messages are compiled together where
# the generator allows it, which saves a third of the rest.
function(_adapt_to_wheels)
  get_property(_targets DIRECTORY PROPERTY IMPORTED_TARGETS)
  foreach(_target IN LISTS _targets)
    get_target_property(_includes ${_target} INTERFACE_INCLUDE_DIRECTORIES)
    if(_includes)
      list(FILTER _includes EXCLUDE REGEX "^/opt/python/")
      set_target_properties(${_target} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${_includes}")
    endif()
  endforeach()
  get_property(_targets DIRECTORY PROPERTY BUILDSYSTEM_TARGETS)
  list(FILTER _targets INCLUDE REGEX "__rosidl_typesupport_(c|fastrtps_c)$")
  foreach(_target IN LISTS _targets)
    set_target_properties(${_target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 12)
  endforeach()
endfunction()
cmake_language(DEFER CALL _adapt_to_wheels)
