# ROS 2 installed from Python wheels: the exported target <package>__rosidl_generator_py names include folders of the
# machine the wheel was built on, and CMake stops at imported targets with non-existent include folders. Those folders
# (Python and NumPy) are found anew for this build, so the dead entries are dropped. An apt installation has none.
function(drop_missing_include_directories target)
  if(NOT TARGET ${target})
    return()
  endif()
  get_target_property(include_directories ${target} INTERFACE_INCLUDE_DIRECTORIES)
  set(kept "")
  foreach(directory IN LISTS include_directories)
    if(NOT IS_ABSOLUTE "${directory}" OR EXISTS "${directory}")
      list(APPEND kept "${directory}")
    endif()
  endforeach()
  set_target_properties(${target} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${kept}")
endfunction()
