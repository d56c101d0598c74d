/* Rows that Python gives: Residual and Constraint, in rcmqp/tasks and rcmqp/limits. */
#ifndef RCMQP_GIVEN_H
#define RCMQP_GIVEN_H

#include "arrays.h"
#include "stack.h"

int read_given(Stack *stack, PyObject *given);

#endif
