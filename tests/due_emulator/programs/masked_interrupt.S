// A masked interrupt waits, and is taken in a window of two unmasked instructions.
// handlers: 47 handler
// slots: 1 0, 2 9
  movs r2, #0
  keep r2, 0
  cpsid i
  store 0xE000E100, 0x80000000
  trigger 31
  .rept 300
  nop
  .endr
  load r3, 0x20070000
  keep r3, 1
1: cpsie i
  cpsid i
  load r3, 0x20070000
  cmp r3, #0
  beq 1b
  keep r3, 2
  wait_forever
handler:
  movs r2, #9
  keep r2, 0
  bx lr
