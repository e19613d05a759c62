// IPSR and the registers of the NVIC show which interrupts are pending and active.
// handlers: 47 handler
// slots: 0 0x80000000, 1 47, 2 0x80000000, 3 0, 4 0x80000000, 5 0
  store 0xE000E100, 0x80000000
  load r1, 0xE000E100
  keep r1, 0
  trigger 31
  nop
  load r1, 0xE000E300
  keep r1, 3
  store 0xE000E180, 0x80000000
  store 0xE000E200, 0x80000000
  load r1, 0xE000E200
  keep r1, 4
  store 0xE000E280, 0x80000000
  load r1, 0xE000E200
  keep r1, 5
  wait_forever
handler:
  mrs r1, ipsr
  keep r1, 1
  load r1, 0xE000E300
  keep r1, 2
  bx lr
