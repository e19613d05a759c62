// The stack is aligned for a handler, 4 and 32 bytes lower, and then restored.
// handlers: 47 handler
// slots: 0 0x20087ffc, 1 0x20087ffc, 2 0x20087fd8
  store 0xE000E100, 0x80000000
  push {r1}
  mov r4, sp
  keep r4, 0
  trigger 31
  nop
  mov r4, sp
  keep r4, 1
  wait_forever
handler:
  mov r2, sp
  keep r2, 2
  bx lr
