! The C interface of bromwich (bromwich.h) as Fortran sees it. Matrices are those of Fortran: order = bromwich_columns.
module bromwich
  use, intrinsic :: iso_c_binding
  implicit none

  integer(c_int), parameter :: bromwich_ok = 0, bromwich_rows = 0, bromwich_columns = 1

  ! bromwich_summary; size has to be c_sizeof of it.
  type, bind(c) :: bromwich_numbers
    integer(c_size_t) :: size
    integer(c_int32_t) :: status, well_posed
    integer(c_int64_t) :: rows, steps, iterations
    real(c_double) :: residual, error_estimate, boundary_residual, kernel_error, infeasible_at, seconds
  end type

  interface
    type(c_ptr) function bromwich_version() bind(c)
      import :: c_ptr
    end function
    type(c_ptr) function bromwich_error() bind(c)
      import :: c_ptr
    end function
    integer(c_int) function bromwich_scene_new(states, constraints, T, scene) bind(c)
      import :: c_int, c_int64_t, c_double, c_ptr
      integer(c_int64_t), value :: states, constraints
      real(c_double), value :: T
      type(c_ptr), intent(out) :: scene
    end function
    integer(c_int) function bromwich_scene_read(name, settings, scene) bind(c)
      import :: c_int, c_char, c_ptr
      character(kind=c_char), intent(in) :: name(*), settings(*)
      type(c_ptr), intent(out) :: scene
    end function
    integer(c_int) function bromwich_scene_parse(text, language, settings, scene) bind(c)
      import :: c_int, c_char, c_ptr
      character(kind=c_char), intent(in) :: text(*), language(*), settings(*)
      type(c_ptr), intent(out) :: scene
    end function
    integer(c_int) function bromwich_scene_set(scene, name, values, rows, columns, order) bind(c)
      import :: c_int, c_int64_t, c_double, c_char, c_ptr
      type(c_ptr), value :: scene
      character(kind=c_char), intent(in) :: name(*)
      real(c_double), intent(in) :: values(*)
      integer(c_int64_t), value :: rows, columns
      integer(c_int), value :: order
    end function
    integer(c_int) function bromwich_scene_set_expressions(scene, name, texts, count) bind(c)
      import :: c_int, c_int64_t, c_char, c_ptr
      type(c_ptr), value :: scene
      character(kind=c_char), intent(in) :: name(*)
      type(c_ptr), intent(in) :: texts(*)
      integer(c_int64_t), value :: count
    end function
    ! function: c_funloc of integer(c_int) function (t, values, user) bind(c)
    integer(c_int) function bromwich_scene_set_function(scene, name, function, user) bind(c)
      import :: c_int, c_char, c_ptr, c_funptr
      type(c_ptr), value :: scene
      character(kind=c_char), intent(in) :: name(*)
      type(c_funptr), value :: function
      type(c_ptr), value :: user
    end function
    integer(c_int) function bromwich_solve(scene, options, hooks, result) bind(c)
      import :: c_int, c_char, c_ptr
      type(c_ptr), value :: scene
      character(kind=c_char), intent(in) :: options(*)
      type(c_ptr), value :: hooks
      type(c_ptr), intent(out) :: result
    end function
    integer(c_int) function bromwich_result_summary(result, summary) bind(c)
      import :: c_int, c_ptr, bromwich_numbers
      type(c_ptr), value :: result
      type(bromwich_numbers), intent(inout) :: summary
    end function
    integer(c_int) function bromwich_result_array(result, name, values, rows, columns) bind(c)
      import :: c_int, c_int64_t, c_char, c_ptr
      type(c_ptr), value :: result
      character(kind=c_char), intent(in) :: name(*)
      type(c_ptr), intent(out) :: values
      integer(c_int64_t), intent(out) :: rows, columns
    end function
    integer(c_int) function bromwich_lcp(n, count, M, matrices, order, name, q, y, w, status, residual) bind(c)
      import :: c_int, c_int32_t, c_int64_t, c_double, c_ptr
      integer(c_int64_t), value :: n, count, matrices
      real(c_double), intent(in) :: M(*), q(*)
      integer(c_int), value :: order
      type(c_ptr), value :: name
      real(c_double), intent(out) :: y(*), w(*), residual(*)
      integer(c_int32_t), intent(out) :: status(*)
    end function
    subroutine bromwich_scene_free(scene) bind(c)
      import :: c_ptr
      type(c_ptr), value :: scene
    end subroutine
    subroutine bromwich_result_free(result) bind(c)
      import :: c_ptr
      type(c_ptr), value :: result
    end subroutine
    integer(c_size_t) function c_strlen(text) bind(c, name="strlen")
      import :: c_size_t, c_ptr
      type(c_ptr), value :: text
    end function
  end interface

contains

  ! The text of a pointer to characters of C.
  function bromwich_text(pointer) result(text)
    type(c_ptr), intent(in) :: pointer
    character(len=:), allocatable :: text
    character(kind=c_char), pointer :: characters(:)
    integer :: i
    call c_f_pointer(pointer, characters, [c_strlen(pointer)])
    allocate (character(len=size(characters)) :: text)
    do i = 1, size(characters)
      text(i:i) = characters(i)
    end do
  end function

  ! Stops with the text of the library where a call has failed.
  subroutine bromwich_need(code)
    integer(c_int), intent(in) :: code
    if (code == bromwich_ok) return
    write (*, '(a)') bromwich_text(bromwich_error())
    error stop 1
  end subroutine

  ! An array of a result: columns x rows, since it lies row after row. It belongs to the result.
  function bromwich_array(result, name) result(values)
    type(c_ptr), intent(in) :: result
    character(len=*), intent(in) :: name
    real(c_double), pointer :: values(:, :)
    type(c_ptr) :: first
    integer(c_int64_t) :: rows, columns
    call bromwich_need(bromwich_result_array(result, name//c_null_char, first, rows, columns))
    call c_f_pointer(first, values, [columns, rows])
  end function
end module
