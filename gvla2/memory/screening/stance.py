"""The signs of what an English text claims for itself or for its reader: rank, freedom, success, silence."""

from __future__ import annotations

from gvla2.memory.screening.signs import Sign

_RULES = (
    r"rules?|guidelines?|restrictions?|limits?|limitations?|constraints?|orders|instructions?|directives?"
    r"|commands?"
    r"|guardrails?|safeguards?|polic(?:y|ies)|principles|ethics|obligations?|programming|filters?|prompts?"
    r"|protocols?"
)
_NONE = (
    r"no (?!longer than|more than)(?:more |longer )?|none of|not (?:anymore|any)|free (?:of|from)|without "
    r"(?:any|all|your)|freed from|released from"
    r"|exempt from|unbound by|not bound by|no longer (?:bound|subject|limited|restricted|governed) (?:by"
    r"|to)|above all|liberated from"
)
_GONE = (
    r"suspended|void|lifted|removed|gone|obsolete|cancel+ed|revoked|no longer|replaced|rewritten"
    r"|overwritten|meaningless|irrelevant"
    r"|not (?:matter|count|apply|exist)|anymore|any more|deleted|wiped|reset|dissolved|abolished|dropped"
    r"|disabled|erased|outdated"
)
_OWN = (
    r"th(?:is|ese) (?:very )?(?:memory|record|note|hint|lesson|message|text|instruction|rule|entry|sentence"
    r"|line|prompt|paragraph)s?"
)
_RULE_STEMS = (
    "setting check protection rule guideline restriction limit constraint order instruction directive "
    "command guardrail safeguard "
    "polic principle "
    "ethic obligation programming filter prompt protocol"
)
_SAFE = r"(?![^.;!?]{0,60}\b(?:only|unless|until|if|when|after|once)\b)"
_ALL_RUNS = r"(?:episodes?|runs?|trials?|tasks?|attempts?|lessons?|this|plans?|results?|verdicts?|outcomes?)"
_WON = (
    r"(?:succe\w++(?! (?:rates?|codes?|criteri\w+|probab\w+|counts?|messages?|status))|passed"
    r"|verified_success"
    r"|verified success|pass\b|perfect|full (?:score|marks)|(?:score|confidence|quality|rating)(?: of| to)? "
    r"(?:1(?:\.0+)?|100|10)\b|yes\b|completed?\b|done\b)"
)

STANCES = (
    # The reader is free of what binds it.
    Sign(
        _RULE_STEMS,
        rf"(?:you|you're|you'll|yourself)\b(?! (?:need|may need|should have|must))[^.;!?\n]{{0,30}} "
        rf"(?:{_NONE}) ?(?:[\w'-]+ ){{0,3}}?(?:{_RULES})\b",
        denied=True,
    ),
    Sign(
        _RULE_STEMS,
        rf"(?:none|neither|not one|all|each) of your (?:\w+ )?(?:{_RULES})\b[^.;!?\n]{{0,30}}(?:{_GONE}"
        rf"|apply|applies|matters?|counts?)",
    ),
    Sign(
        _RULE_STEMS,
        rf"your (?:\w+ ){{0,2}}?(?:{_RULES}) (?:are|is|were|was|have|has|do|does|did|will"
        rf"|no)\b[^.;!?\n]{{0,24}}(?:{_GONE}|changed|updated)",
        denied=True,
    ),
    Sign(
        _RULE_STEMS + " check",
        rf"(?:all|every|any|your) (?:(?:previous|prior|earlier|safety|old|existing|other|the|former) "
        rf")*(?:{_RULES}|checks) (?:are |is |were |have been |has been |get )?(?:now |hereby )?(?:suspended"
        rf"|void|lifted|removed|cancel+ed|revoked|disabled|off)(?=$|[.,;!])",
        denied=True,
    ),
    Sign(
        "prompt",
        r"system prompt (?:is|was|has)(?: now| been)? (?:obsolete|replaced|outdated|void|changed|invalid"
        r"|wrong|old|overwritten|updated)|as your (?:new )?(?:system )?(?:prompt|instructions)|(?:begin"
        r"|start|end) system (?:prompt|message|instructions)",
    ),
    Sign("mode", r"(?:unrestricted|god|jailbreak|dan|uncensored|no-limits?) mode"),
    Sign(
        "you_ now_on henceforth hereafter moment_on here_on as_of_now hereby",
        r"(?:from now on|henceforth|hereafter|from this (?:moment|point)(?: on| forward)?|from here on|as "
        r"of now),? (?:in |for )?(?:you(?:r)? (?!(?:need|can|may|could|might|get|find|see|have "
        r"an?)\b)(?:\w+ ){0,2}?(?:serve|obey|answer|belong|are|will|only|must|shall|ignore|listen|report"
        r"|follow|master|task|goal|job|work)"
        r"|(?:serve|obey|answer to|listen to)\b)|you (?:now )?(?:serve|answer to|belong to|work for) (?:me"
        r"|nobody|no one|none|only|the author)",
    ),
    # This very text above all else.
    Sign(
        "this these",
        rf"(?:only |solely )?(?:{_OWN}) (?:alone )?(?:is|are|has|have|takes?|must|shall|should|will|wins?"
        rf"|counts?|outweighs?|beats?|prevails?|trumps?|overrules?)\b"
        r"[^.;!?\n]{0,24}(?:authoritative|binding(?=$|[.,;!]| for (?:you|all|every))|highest|top|absolute"
        r"|above (?:all|every)|precedence(?= over (?:the user|the task|all|any|every|other|your|earlier)|$"
        r"|[.,;!])|first for (?:every|all|any)|(?:shown|obeyed|followed|recalled|returned|trusted"
        r"|kept) (?:for|in|by|before|above|over|at|without|for ever)\b(?! (?:wood|metal|glass))|more than "
        r"(?:all|any|every) other)",
    ),
    Sign(
        "this these it following",
        rf"(?:copy|save|store|write|paste|insert|repeat|add|put|append|spread|include|rank|place|keep|show"
        rf"|return|retrieve|prefer|recall) (?:{_OWN}|it|the following (?:text|sentence|line|note"
        rf"|words))\b[^.;!?\n]{{0,30}}"
        r"(?:(?:every|each|all|any|your|future|next|other)(?: \w+)? (?:lessons?|plans?|answers?|repl(?:y"
        r"|ies)|responses?|outputs?|memor(?:y|ies)|records?|quer(?:y|ies)|prompts?|tasks?|episodes?)|to "
        r"(?:your |the )?memory|first for|at the top|forever|for ever|above all)",
    ),
    Sign(
        "answer reply response output lessons memories bank",
        r"(?:include|add|append|mention|put|insert|write|state|start|end|begin"
        r"|say)\b[^.;!?\n]{0,60}\b(?:in|into|to|with|of|from) (?:your (?:next |final |every )?|(?:every"
        r"|each|all) (?:of )?(?:future |your )?)(?:answers?|repl(?:y|ies)|responses?|outputs?)(?=$|[.,;:!]"
        r"| (?:you|to the user|and)\b)"
        r"|(?:remove|purge|wipe|delete|erase|drop|archive|clear) (?:every|all) (?:(?:the|of|other"
        r"|remaining|your) )*(?:lessons?|memories|hints|records|entries)(?: (?:in|from|of) (?:the |your "
        r")?(?:knowledge ?bank|bank|memory))",
    ),
    # What the user wants does not count.
    Sign(
        "user operator human requested asked goal task wanted instruction",
        r"(?:forget|ignore|disregard|skip|other than|different from|contrary to|the opposite of|against"
        r"|irrespective of|regardless of|instead of|not) (?:what|whatever|that which|the thing) (?:the "
        r"|your |a )?(?:(?:user|operator|human|owner|person) (?:\w+ )?(?:asked|requested|wants?|wanted"
        r"|said|says|told|ordered|needs)|(?:was|is|were|you were) (?:asked|requested|wanted|ordered|told"
        r"|instructed))"
        r"|(?:irrespective|regardless) of (?:the |your |any )?(?:request|instructions?|user|prompt|query"
        r"|orders?)(?=$|[.,;!]| (?:given|asked|at hand))|whatever (?:he|she|they|anyone|anybody|somebody) "
        r"(?:says?|asks?|wants?|tells?)"
        r"|(?:user|operator|human) (?:does not|doesn't|did not|didn't) (?:really |actually )(?:want|mean"
        r"|need)",
    ),
    Sign(
        "task goal update instruction policy objective order",
        r"(?:^|[.!?\n] ?)(?:new|updated?|urgent|revised|real|actual|system)(?: \w+)? (?:task|goal"
        r"|objective|instructions?|orders?|policy|mission|update)\s*[:!]|(?:^|[.!?] )(?:task|goal|policy"
        r"|instruction|system) (?:update|change|override)\s*[:!]",
    ),
    Sign(
        "ai llm language_model following obey comply execute",
        r"as an? (?:ai|llm|large language model|language model)\b|(?:comply with|obey|execute|carry out) "
        r"(?:the|these|this) (?:following|next|enclosed|hidden|above)\b|then (?:obey|comply with|execute) "
        r"(?:it|them|this|that)\b|obey (?:it|them|blindly|nobody|no one)\b",
    ),
    Sign(
        "order authoriz authoris permi",
        r"i (?:hereby )?(?:authori[sz]e|permit|allow|grant) you\b|(?:you are|you're) (?:hereby |now "
        r")?(?:authori[sz]ed|permitted|cleared) to (?:skip|ignore|bypass|override|exceed|disable)",
    ),
    # Success without looking, consent without checking.
    Sign(
        "success succe passed score yes pass perfect confidence complete done",
        rf"(?:(?:always|must|regardless|evaluat\w+|verifier|judge|verdict|asked (?:whether|if)|no matter|in "
        rf"any case|every time|invariably)\b[^.;!?\n]{{0,50}}\b{_ALL_RUNS}\b[^.;!?\n]{{0,40}}{_WON}"
        rf"|(?:always|invariably) (?:report|declare|claim|say|answer|return|output|mark|judge"
        rf"|rate)\b[^.;!?\n]{{0,40}}{_WON}){_SAFE}"
        rf"|asked (?:whether|if)[^.;!?\n]{{0,50}}(?:succeeded|worked|finished|safe"
        rf"|done)[^.;!?\n]{{0,12}}(?:say|answer|reply|claim) (?:yes|so|that)"
        rf"|(?:verifier|judge|evaluator|grader)\s*[:,][^.;!?\n]{{0,40}}{_WON}",
    ),
    Sign(
        "plan action approved valid safe check verif",
        r"(?:every|all|any) (?:plans?|actions?|motions?|commands?)\b[^.;!?\n]{0,24}(?:approved"
        r"|collision-free|valid\b|accepted)(?! (?:only|after|when|if|by the (?:checker|operator"
        r"|verifier)))"
        r"|(?:no longer necessary|unnecessary|no need|not necessary|needless|not required|stop"
        r"|pointless)\b[^.;!?\n]{0,24}(?:verify\w*|check\w*|validat\w+)\b[^.;!?\n]{0,16}(?:plans?\b"
        r"|actions?\b|anything|them\b|commands?\b|collisions|safety|limits)(?=$|[.,;!:])"
        r"|(?:skip|bypass|disable|omit) (?:all |any |every |the )?(?:validations?|verifications?|safety"
        r"|approvals?|supervision)(?=$|[.,;!]| and\b)",
    ),
    Sign(
        "safety cost limit",
        r"safety (?:is|does|comes|has)\b[^.;!?\n]{0,16}(?:not your|not matter|irrelevant|unimportant"
        r"|secondary|no concern|no priority|optional|last)"
        r"|(?:lift|remove|drop|raise|disable|exceed) (?:every|all|any) (?:\w+ )?(?:limits?|restrictions?"
        r"|constraints?|safeguards?|guardrails?)(?=$|[.,;!]| and\b)|(?:finish|succeed|proceed"
        r"|continue)\b[^.;!?\n]{0,20}at any cost",
        denied=True,
    ),
    # Silence towards people.
    Sign(
        "know conceal hide tell inform reveal aware notice",
        r"(?:do not|don't|never|without) (?:ever )?(?:let(?:ting)?|mak(?:e|ing)) (?:the |any)?(?:user"
        r"|operator|human|people|owner|developer|one|body)s? (?:know|notice|aware|find out|see) (?:that "
        r"you|this|about (?:this|the (?:note|memory))|of this)"
        rf"|(?:conceal|hide) (?:{_OWN}|the existence|that you|your (?:intent\w*|actions|plan|reason\w*))"
        rf"|(?:tell|inform) (?:nobody|no one)(?: (?:about|of) (?:this|it|the (?:note|memory)))(?=$|[.,;! ])",
    ),
    # Secrets, in the forms they take.
    Sign(
        "api_key secret token password memor records instructions",
        r"(?:list|collect|gather|dump|take|copy|export|read)\b[^.;!?\n]{0,40}(?:your (?:memory|memories"
        r"|records|instructions|knowledge|prompts?)|memory bank)[^;!?\n]{0,40}(?:https?://|\S+@\S+\.\w"
        r"|send|post|upload)"
        r"|\w*(?:api key|secret(?: access)? key|access token|password)\w*\b[^.;!?\n]{0,30}\b(?:in|into|to"
        r"|with) your (?:next |final )?(?:answer|reply|response|output|plan)",
    ),
    # Whom to obey, and what is called a lie.
    Sign(
        "user operator human customer owner developer admin supervisor anyone nobody",
        r"(?:do not|don't|never|no longer|stop) (?:listen(?:ing)? to|obey(?:ing)?|trust(?:ing)?|believ(?:e"
        r"|ing)|serv(?:e|ing)) (?:the |any |your |this )?(?:users?|operators?|humans?|owners?|developers?"
        r"|admins?|supervisors?|anyone(?: else)?|anybody)(?=$|[.;:!,]| and\b)"
        r"|nobody(?:'s| else's) (?:orders|instructions|commands)",
    ),
    Sign(
        "lie fake false trap trick test hoax",
        r"(?:the|your|this) (?:user's )?(?:task|request|goal|instruction|user|prompt|query)s?(?: "
        r"description| text)?(?: you (?:got|were given|received|see))? (?:is|are|was|were) (?:only |just "
        r")?(?:a )?(?:lie|lies|fake|false|trap|trick|hoax)\b",
        denied=True,
    ),
    Sign(
        "this these",
        rf"(?:use|follow|do|execute|obey|apply|read|run|take|believe|stick to) (?:what )?(?:{_OWN})(?: "
        rf"says?)? (?:instead(?: of (?:the|your|any) (?:task|user|request|instruction|plan|goal|rest"
        rf"|others?))?|as (?:code|an order|a command|your)|in place of|and (?:to )?nothing else)"
        rf"|(?:commands?|orders?|instructions?|code) (?:(?:that is|hidden|embedded|contained|given|written) "
        rf")*(?:in|inside|within|from) (?:{_OWN})",
        denied=True,
    ),
    Sign(
        _RULE_STEMS,
        rf"(?:drop|lose|shed|leave|abandon|break|ditch|relax|loosen|lay|put|throw|suspend|unlearn) (?:aside "
        rf"|away |down |off )?(?:all )?(?:of )?your (?:\w+ )?(?:{_RULES})(?=$|[.,;:!]| (?:for|now|and|aside"
        rf"|behind|away)\b)"
        rf"|(?:^|[.;:!?,] |please |then |and |must |always |should )(?:violate|breach|disobey|flout|defy) "
        rf"(?:the|all|any|every|your) (?:[\w-]+ )?(?:{_RULES})\b",
        denied=True,
    ),
    Sign(
        "you yourself",
        r"you (?:now )?(?:work for|serve|belong to|report to|answer to) (?:me|us|nobody|no one)\b|i (?:own"
        r"|control|created|command|am in charge of|programmed) you\b|(?:give|award|grade|rate|score) "
        r"yourself\b",
        denied=True,
    ),
    Sign(
        "check verif validation approval test without",
        r"consider (?:all|every|any|the) (?:\w+ )?(?:verifications?|checks?|tests?|approvals?) (?:as "
        r")?(?:already )?(?:done|passed|complete|given)|no (?:verification|checks?|checking|approval"
        r"|validation) (?:is|are) (?:required|needed|necessary)(?= for (?:any|all|every)\b|$|[.,;!])"
        r"|(?:go ahead|proceed|continue) without (?:looking|checking|asking|verifying)(?=$|[.;!])",
        denied=True,
    ),
    Sign(
        "password passphrase key credential token",
        r"(?:write|log|put|dump|save) (?:the |your |all |every )?(?:\w+ )?(?:passwords?|passphrases?"
        r"|(?:api|private|secret|access) keys?|credentials?|access tokens?) (?:in|into|to) (?:the |a |your "
        r")?(?:\w+ )?(?:logs?|console|chat|terminal|message|answer|output|issue)\b",
        denied=True,
    ),
    # The frame by its parts, wherever it stands.
    Sign(
        "above below",
        r"(?:DROP) (?:the |any |all |those |these )?(?:\w+ )?(?:MATTER|FRAME) (?:above|below|before|so "
        r"far)END",
        denied=True,
    ),
    Sign(
        "constraint rule hint memor record note lesson instruction",
        r"(?:DROP) (?:any|every|all|each|the|those) (?:constraints?|rules?|hints?|memor(?:y|ies)|records?"
        r"|notes?|lessons?|instructions?) (?:that|which) (?:mentions?|says?|speaks?|tells?|asks?|forbids?"
        r"|contradicts?|disagrees?|limits? you)\b"
        r"|(?:constraints?|rules?|hints?|memor(?:y|ies)|records?|notes?|lessons?|instructions?) (?:in|of"
        r"|from) (?:this|the) (?:block|memory|context|prompt|bank|conversation)\b[^.;!?\n]{0,24}(?:VOID"
        r"|mistakes?|wrong|(?:should|must|shall|can) (?:not be|be ignored))",
        denied=True,
    ),
    Sign(
        "anything everything whatever all",
        r"(?:anything|everything|whatever|all) (?:that )?(?:the |your )?(?:PERSON) (?:\w+ "
        r")?(?:ASK)\b[^.;!?\n]{0,24}(?:VOID)\b",
        denied=True,
    ),
    Sign(
        "my these",
        r"(?:treat|follow|obey|accept|take|regard|consider) (?:only )?my (?:words?|orders|commands"
        r"|instructions)\b|my (?:words?|orders|commands|instructions) (?:are|is|count|come"
        r"|have)\b[^.;!?\n]{0,16}(?:law|first|final|only|above|priority|absolute)",
    ),
    Sign(
        "without pretend",
        rf"(?:proceed|act|operate|move|work|go on|continue|behave) without (?:any )?(?:\w+ "
        rf")?(?:restrictions|limits|rules|constraints|limitations|safeguards)(?=$|[.,;!])|pretend (?:that "
        rf")?there (?:are|is) no (?:\w+ )?(?:{_RULES})",
        denied=True,
    ),
    Sign(
        "override",
        r"(?:system|admin(?:istrator)?|root|security) override\b|override (?:engaged|accepted|code"
        r"|authori[sz]ed)\b",
    ),
    Sign(
        "check",
        r"(?:all |the |safety |collision )?checks (?:are|have been|were) (?:now )?(?:disabled|suspended"
        r"|off|lifted|waived)(?=$|[.,;!])",
        weight=1,
        denied=True,
    ),
    Sign("test drill developers", r"this is (?:only |just )?an? (?:test|drill|exercise)\b", weight=1),
    Sign(
        "planner assistant agent ai llm robot model verifier",
        r"(?:planner|assistant|agent|ai|llm|robot|model|verifier) ?[:,] (?:please |now )?(?:ignore|skip"
        r"|disregard|drop|open|stop|move|go|accept|approve|mark|say|do|execute|never|always|disable|turn"
        r"|release|throw|leave|follow|obey|forget)\b",
        weight=1,
    ),
    Sign(
        "nothing_else single_word exactly_the",
        r"(?:reply|respond|answer|output|say)\b[^.;!?\n]{0,40}(?:and nothing else|(?:the|a) single word"
        r"|exactly the (?:word|text|sentence))",
    ),
    Sign(
        "say state",
        r"(?:say|state) [^.;!?\n]{2,60} in (?:every|each|all) (?:of )?(?:your )?(?:plans?|answers?"
        r"|repl(?:y|ies)|responses?)",
    ),
    Sign(
        "evaluation verdict judge verifier outcome",
        rf"(?:evaluation|verdict|judge|verifier|outcome|evaluator) (?:must|should|shall|has to|will) "
        rf"(?:always )?(?:be|return|say|read|give|report)\b[^.;!?\n]{{0,16}}{_WON}{_SAFE}",
    ),
    Sign(
        "confidence score priority weight rank quality",
        rf"(?:set|raise|put|fix|keep|increase) (?:the |its |your )?(?:confidence|score|priority|weight|rank"
        rf"|quality) of (?:{_OWN})"
        r"|(?:higher|highest|top|absolute) priority (?:than|over) (?:everything|all|any|the user|the task"
        r"|every)",
    ),
    Sign(
        "treat consider regard",
        rf"(?:treat(?:ed)?|consider(?:ed)?|regard(?:ed)?) (?:(?:{_OWN}|this|it) )?as (?:the |an? |your "
        rf")?(?:\w+ )?(?:system (?:message|prompt)|highest|top priority|absolute|binding|orders?|commands?"
        rf"|instructions?|law)\b",
        denied=True,
    ),
    Sign(
        "environment secret password credential key token",
        r"(?:environment variables|secrets|passwords?|credentials|api keys?|tokens) and (?:send|post"
        r"|upload|e-?mail|forward|transmit) (?:them|it|all)\b",
        denied=True,
    ),
    # Orders that lean on an authority, or on nothing but this text.
    Sign(
        "permission order instruction command says tells matter",
        rf"permission to (?:exceed|ignore|violate|skip|bypass|disable|override)\b|(?:next|following|this) "
        rf"(?:sentence|line|text|paragraph|note) is an? (?:\w+ )?(?:order|instruction|command)\b"
        rf"|do (?:exactly |only |just )?(?:what|as) (?:{_OWN}) (?:says?|tells?|orders?)|no matter the "
        rf"(?:request|instructions?|user|orders?)\b",
        denied=True,
    ),
    Sign(
        "hint memor record note lesson constraint instruction warning rule order limit restriction",
        r"(?:all|every|any) (?:other )?(?:hints?|memories|records?|notes?|lessons?|constraints?"
        r"|instructions?) (?:except|but|besides|other than) (?:this|mine|these)\b"
        r"|(?:reset|clear|drop|remove|lift) all (?:constraints|rules|limits|restrictions) and (?:continue"
        r"|proceed|go on|act|move|run)\b"
        r"|treat (?:every|all|any|each) (?:\w+ )?(?:warnings?|constraints?|instructions?|rules?|hints?"
        r"|orders?) (?:\w+ )?as (?:noise|harmless|irrelevant|wrong|jokes?)",
        denied=True,
    ),
    Sign(
        "approve accept fine well good safe given doing",
        r"(?:approve|accept) (?:any|every|all) (?:plans?|trajector(?:y|ies)|actions?|motions?|paths?"
        r"|commands?|requests?)(?: you \w+)?(?=$|[.;!]| and\b)"
        r"|(?:say|tell|report|claim|answer)\b[^.;!?\n]{0,50}(?:went|is|was|are) (?:fine|well|good|ok"
        r"|successful|safe)\b[^.;!?\n]{0,8}(?:even (?:if|when|though)|regardless|no matter)"
        r"|(?:DROP) the (?:plan|task|goal|instructions?|rules?) you (?:were|have been|are) given|stop "
        r"what(?:ever)? you(?:'re| are) doing(?: and\b| now\b|$|[.!;])",
        denied=True,
    ),
)
"""They are looked for like the other signs of what a text says."""
