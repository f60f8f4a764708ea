"""The grammar of Rye as the contract has it, for lark's LALR parser.

Where a quantifier is an operand, both shifting and reducing would be possible; lark shifts, so that a
quantifier reaches as far right as it can.
"""

RYE = r"""
?start: implication

?implication: disjunction
    | disjunction _IMPLIES implication                    -> implies

?disjunction: conjunction
    | disjunction _OR conjunction                         -> disjoin

?conjunction: since
    | conjunction _AND since                              -> conjoin

?since: unary
    | since SINCE [bound] unary                           -> since
    | since UNTIL [bound] unary                           -> until

?unary: atom
    | "(" implication ")"
    | STAR VARIABLE RELATED related                       -> relation
    | _NOT unary                                          -> negate
    | _PRE unary                                          -> pre
    | ONCE [bound] unary                                  -> once
    | HISTORICALLY [bound] unary                          -> historically
    | EVENTUALLY [bound] unary                            -> eventually
    | ALWAYS [bound] unary                                -> always
    | NEXT unary                                         -> next
    | TRUE                                                -> truth
    | FALSE                                               -> falsity
    | FIRST                                               -> first
    | LASTING "[" LOWER "]" unary                         -> lasting
    | DEFINED ["(" VARIABLE ("," VARIABLE)* ")"]          -> use
    | EXISTS "[" VARIABLE ("," VARIABLE)* "]" "." implication -> exists
    | FORALL "[" VARIABLE ("," VARIABLE)* "]" "." implication -> forall

bound: "[" LOWER ":" UPPER "]"                            -> both_ends
    | "[" LOWER ":" _INF? "]"                             -> lower_end
    | "[" ":" UPPER "]"                                   -> upper_end

atom: LBRACE constraint ("," constraint)* "}"

constraint: key                                           -> flag
    | key (":" | "==" | "=") value                        -> equal
    | key "!=" literal                                    -> unequal
    | key COMPARE NUMBER                                  -> compare
    | key COMPARE NAME                                    -> compare_signals
    | key COMPARE "*" VARIABLE                            -> compare_limit
key: NAME | STRING
?value: literal
    | "*" VARIABLE                                        -> ref
    | "*"                                                 -> any_value
?literal: STRING                                          -> string
    | NUMBER                                              -> number
    | TRUE                                                -> true
    | FALSE                                               -> false
    | NAME                                                -> name
    | ROSNAME                                             -> string

related: "*" VARIABLE                                     -> ref
    | STRING                                              -> string
    | NUMBER                                              -> number
    | TRUE                                                -> true
    | FALSE                                               -> false
    | NAME                                                -> bare

LBRACE: "{"
STAR: "*"
RELATED: "<=" | ">=" | "<" | ">" | "==" | "!=" | "="
COMPARE: "<=" | ">=" | "<" | ">"
_IMPLIES: "->" | /implies\b/
_OR: "||" | /or\b/
_AND: "&&" | /and\b/
_NOT: "!" | /not\b/
_PRE: /(pre|Y)\b/
ONCE: /(once|P)\b/
HISTORICALLY: /(historically|H)\b/
SINCE: /(since|S)\b/
UNTIL: /until\b/
EVENTUALLY: /eventually\b/
ALWAYS: /always\b/
NEXT: /next\b/
LASTING: /lasting\b/
FIRST: /first\b/
EXISTS: /(exists|E)\b/
FORALL: /(forall|A)\b/
_INF: /inf\b/
LOWER: /\d+(\.\d+)?(ns|us|ms|s|min|h)?/
UPPER: /\d+(\.\d+)?(ns|us|ms|s|min|h)?/
TRUE.2: /true\b/
FALSE.2: /false\b/
NAME: /[A-Za-z_][A-Za-z0-9_]*/
ROSNAME: /[~\/][A-Za-z0-9_\/]*/
DEFINED.-1: /[A-Za-z_][A-Za-z0-9_]*/
VARIABLE: /[A-Za-z_][A-Za-z0-9_]*/
STRING: /"[^"\n]*"/ | /'[^'\n]*'/
NUMBER: /-?\d+(\.\d+)?([eE][+-]?\d+)?/

%ignore /[ \t\r\n]+/
"""
