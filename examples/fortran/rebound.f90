! Two masses in a row, the second one against a damped stop, with a force that is a function of Fortran.
!
!     q1'' = -2 q1 + q2 + sin t,  q2'' = q1 - 2 q2 + y,   0 <= y ⊥ q2 + 0.1 + 0.01 y >= 0
!
! With y linear in each step, the steps are exact but for y: halving them shows the error.
module force
  use, intrinsic :: iso_c_binding
  implicit none
contains
  integer(c_int) function push(t, values, user) bind(c)
    real(c_double), value :: t
    real(c_double), intent(out) :: values(4)
    type(c_ptr), value :: user
    values = [0d0, 0d0, sin(t), 0d0]
    push = 0
  end function
end module

program rebound
  use, intrinsic :: iso_c_binding
  use bromwich
  use force
  implicit none
  real(c_double), parameter :: A(4, 4) = reshape([0, 0, -2, 1, 0, 0, 1, -2, 1, 0, 0, 0, 0, 1, 0, 0], [4, 4])
  real(c_double), parameter :: B(4, 1) = reshape([0, 0, 0, 1], [4, 1]), N(1, 4) = reshape([0, 1, 0, 0], [1, 4])
  real(c_double), parameter :: M(1, 1) = 0.01d0, gap(1) = 0.1d0
  real(c_double), pointer :: x(:, :), y(:, :)
  real(c_double) :: coarse(4)
  type(bromwich_numbers) :: numbers
  type(c_ptr) :: scene, result
  character(kind=c_char, len=8), target :: text = "0.1"//c_null_char
  integer(c_int64_t), parameter :: one = 1, four = 4

  call bromwich_need(bromwich_scene_new(four, one, 10d0, scene))
  call bromwich_need(bromwich_scene_set(scene, "A"//c_null_char, A, four, four, bromwich_columns))
  call bromwich_need(bromwich_scene_set(scene, "B"//c_null_char, B, four, one, bromwich_columns))
  call bromwich_need(bromwich_scene_set(scene, "N"//c_null_char, N, one, four, bromwich_columns))
  call bromwich_need(bromwich_scene_set(scene, "M"//c_null_char, M, one, one, bromwich_columns))
  call bromwich_need(bromwich_scene_set_expressions(scene, "g"//c_null_char, [c_loc(text)], one))
  call bromwich_need(bromwich_scene_set_function(scene, "f"//c_null_char, c_funloc(push), c_null_ptr))

  call solve("method=march steps=4000")
  coarse = x(:, size(x, 2))
  call bromwich_result_free(result)
  call solve("method=march steps=8000")
  write (*, '(a, 2f11.7)') "q(10) =", x(1:2, size(x, 2))
  write (*, '(a, f10.6)') "largest force", maxval(y)
  ! Second order, but for the steps in which the contact begins or ends: those have first order each.
  if (maxval(abs(x(:, size(x, 2)) - coarse)) > 1d-4) error stop "the solution depends on the steps"
  if (minval(x(2, :) + gap(1) + M(1, 1) * y(1, :)) < -1d-10) error stop "the stop is passed"
  call bromwich_result_free(result)
  call bromwich_scene_free(scene)

contains

  subroutine solve(options)
    character(len=*), intent(in) :: options
    call bromwich_need(bromwich_solve(scene, options//c_null_char, c_null_ptr, result))
    numbers%size = c_sizeof(numbers)
    call bromwich_need(bromwich_result_summary(result, numbers))
    if (numbers%status /= 0) error stop "not solved"
    x => bromwich_array(result, "x")
    y => bromwich_array(result, "y")
  end subroutine
end program
