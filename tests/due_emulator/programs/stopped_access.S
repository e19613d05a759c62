// Side effects happen once, though Unicorn repeats a stopped access.
// Writing STIR stops the slice in the middle of the access; the handler must run once a write.
// handlers: 47 count
// slots: 0 100
  movs r2, #0
  keep r2, 0
  store 0xE000E100, 0x80000000
  ldr r4, =0xE000EF00
  movs r5, #31
  movs r6, #100
1: str r5, [r4]
  nop
  subs r6, #1
  bne 1b
  wait_forever
  count_ticks
